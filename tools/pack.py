"""Reduce exported scenes to what is committed of them.

    python tools/pack.py branches/fig7 branches/fig8

Tables and large catalogues are compressed, pictures get a palette, and pictures that no page of the
documentation shows are removed. Results are read from compressed files as from others.
"""

from __future__ import annotations

import io
import lzma
import subprocess
import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
TABLES = (
    "*.csv",
    "branches/*.csv",
    "curves/*.csv",
    "simulation/*.csv",
    "maps/*.csv",
    "tables/*.csv",
)
LARGE = {"catalogue.json": 100_000, "simulation/*.json": 10_000}
"""Bytes of JSON files from which on they are compressed."""
MOST = 12_000_000
"""Bytes that all of ``branches/`` may have."""
PAGES = "".join(
    path.read_text(encoding="utf-8")
    for path in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("paper/*.md"))
)


def compress(path: Path) -> None:
    """Replace a file by its compressed form."""
    content = lzma.compress(path.read_bytes(), preset=9 | lzma.PRESET_EXTREME)
    path.with_name(f"{path.name}.xz").write_bytes(content)
    path.unlink()


def reduce_picture(path: Path) -> None:
    """Give a picture a palette of 256 colours, if that makes it smaller."""
    picture, content = Image.open(path).convert("RGB"), io.BytesIO()
    picture.quantize(256, dither=Image.Dither.NONE).save(content, "PNG", optimize=True)
    if len(content.getvalue()) < path.stat().st_size:
        path.write_bytes(content.getvalue())


def pack(folder: Path) -> None:
    """Reduce one folder."""
    for pattern in TABLES:
        for path in folder.glob(pattern):
            compress(path)
    for pattern, large in LARGE.items():
        for path in folder.glob(pattern):
            if path.stat().st_size > large:
                compress(path)
    for path in folder.rglob("*.svg"):
        path.unlink()
    for path in folder.rglob("*.png"):
        if path.resolve().relative_to(ROOT).as_posix() in PAGES:
            reduce_picture(path)
        else:
            path.unlink()


if __name__ == "__main__":
    for name in sys.argv[1:]:
        pack(Path(name.removesuffix("scene.toml")))
    listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "branches"]
    kept = subprocess.check_output(listing, cwd=ROOT, text=True).splitlines()
    total = sum(path.stat().st_size for path in map(ROOT.joinpath, kept) if path.is_file())
    print(f"branches/: {total / 1e6:.1f} MB of at most {MOST / 1e6:g}")
    sys.exit(total > MOST)
