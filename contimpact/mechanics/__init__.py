"""The places where systems written for version 0.1.0 find `Model` and its building blocks."""
