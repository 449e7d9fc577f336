"""Check a built site: no link leads nowhere, nothing is loaded from a network, formulas are set.

    python docs/check_site.py docs/_build/html

Formulas are looked at in Chromium, if it is installed: MathJax marks those it cannot read.
"""

from __future__ import annotations

import html.parser
import shutil
import subprocess
import sys
import urllib.parse
from pathlib import Path

LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}
"""What a browser fetches without being asked, and the attribute that names it."""
UNREAD = ("<merror", 'mathcolor="red"')
"""Marks of MathJax: what it could not read, and commands that it does not know."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


class Page(html.parser.HTMLParser):
    """A page's links, what it loads, and the names of its places."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.places: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.places |= {found.get("id") or "", found.get("name") or ""}
        if tag == "a" and found.get("href"):
            self.links.append(str(found["href"]))
        if found.get(LOADED.get(tag, "")):
            self.loaded.append(str(found[LOADED[tag]]))


def faults(root: Path) -> list[str]:
    """Return what is wrong with the links of a site."""
    pages = {path: Page(path) for path in sorted(root.rglob("*.html"))}
    found = []
    for path, page in pages.items():
        where = path.relative_to(root)
        remote = [t for t in page.loaded if t.startswith(("http:", "https:", "//"))]
        found += [f"{where}: loads {target}" for target in remote]
        for target in page.links + page.loaded:
            parts = urllib.parse.urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            inner = urllib.parse.unquote(parts.path)
            file = (path.parent / inner).resolve() if inner else path
            if not file.exists():
                found.append(f"{where}: {target}: no such file")
            elif parts.fragment and file in pages and not _holds(pages[file], parts.fragment):
                found.append(f"{where}: {target}: no such place")
    return found


def _holds(page: Page, fragment: str) -> bool:
    return urllib.parse.unquote(fragment) in page.places


def unset_formulas(root: Path, browser: str) -> list[str]:
    """Return the pages with formulas that MathJax marks as errors, or does not set at all."""
    found = []
    for path in sorted(root.glob("*.html")):
        if 'class="math' not in path.read_text(encoding="utf-8"):
            continue
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
        command += ["--virtual-time-budget=20000", path.resolve().as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
        if any(mark in done.stdout for mark in UNREAD):
            found.append(f"{path.name}: a formula that cannot be read")
        if "<mjx-container" not in done.stdout:
            found.append(f"{path.name}: formulas are not set")
    return found


def main(folder: str) -> int:
    """Print what is wrong; returns the exit status."""
    root = Path(folder).resolve()
    found = faults(root)
    browser = next((name for name in BROWSERS if shutil.which(name)), None)
    if browser:
        found += unset_formulas(root, browser)
    else:
        print("no browser: formulas are not looked at")
    print("\n".join(found) or "links and formulas hold")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
