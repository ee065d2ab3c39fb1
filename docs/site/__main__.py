"""``python -m docs.site``: stage the pages, make the reference, and build the site strictly.

Nothing is asked of a network, neither here nor by the pages.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

from docs.site.reference import write_reference
from docs.site.stage import ROOT, stage

CONFIG = Path(__file__).with_name("zensical.toml")
OUT = ROOT / "build" / "docs"
OFFLINE = "offline.js"
ASSETS = ("extra.css", "reachable.js", OFFLINE)
"""What the pages load beside the theme."""
ELSEWHERE = "https://unpkg.com/iframe-worker/shim"
"""What the theme loads to search pages that were opened as files."""
_LOADED = re.compile(
    r"""<(?:script|img|iframe|source|video|audio|link\s[^>]*rel="?(?:stylesheet|icon|preload))"""
    r"""[^>]*?\s(?:src|href)="?((?:https?:)?//[^"\s>]+)"""
)


def prepare(folder: Path) -> None:
    """Fill ``folder``, which is emptied first, with all that the builder reads.

    Raises ValueError, a sentence, for a link that leads nowhere.
    """
    shutil.rmtree(folder, ignore_errors=True)
    pages = folder / "pages"
    pages.mkdir(parents=True)
    write_reference(pages / "reference")
    stage(pages)
    shutil.copy(CONFIG, folder / CONFIG.name)
    for name in ASSETS:
        shutil.copy(CONFIG.with_name(name), pages / name)


def build(folder: Path) -> int:
    """Make ``folder``/site; the builder's exit code.

    Raises ValueError as ``prepare`` and ``keep_local``.
    """
    prepare(folder)
    command = [sys.executable, "-m", "zensical", "build", "--strict", "--clean"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    # Coloured letter by letter, and it ends with a traceback where it was strict.
    said, _, _ = (done.stdout + done.stderr).partition("Traceback (most recent call last)")
    print(re.sub(r"\x1b\[[\d;]*m", "", said).strip())
    if done.returncode == 0:
        keep_local(folder / "site")
    return done.returncode


def keep_local(site: Path) -> None:
    """Let pages load our own stand-in for workers, and refuse any that loads from elsewhere."""
    for page in sorted(site.rglob("*.html")):
        depth = len(page.relative_to(site).parts) - 1
        text = page.read_text(encoding="utf-8").replace(ELSEWHERE, "../" * depth + OFFLINE)
        if found := _LOADED.search(text):
            raise ValueError(f"{page.relative_to(site)}: would ask the network for {found[1]}")
        page.write_text(text, encoding="utf-8")


def main() -> int:
    """Build into build/docs; 0 where all links and anchors lead somewhere."""
    try:
        code = build(OUT)
    except ValueError as error:
        print(f"docs: {error}", file=sys.stderr)
        return 2
    if code == 0:
        print(f"next: open {(OUT / 'site' / 'index.html').relative_to(ROOT)} in a browser")
    return code


if __name__ == "__main__":
    sys.exit(main())
