"""The manifest, which ends what a command writes to a folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..results.result_folder import Files, digests_of, manifest_text
from ..results.scene import Scene


def write_manifest(
    scene: Scene, files: Files, left_out: Sequence[str], statistics: Mapping[str, Any]
) -> None:
    """Write the manifest; what could not be written is said."""

    def text() -> str:
        digests = digests_of(files.folder, files.written)
        known = {**statistics, "not_written": files.not_written()}
        return manifest_text(scene.resolved(), scene.given, left_out, known, files.written, digests)

    files.close(text)
