"""Scenes: what to follow, read from TOML and validated."""
