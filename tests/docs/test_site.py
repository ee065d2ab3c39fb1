"""The site: built strictly, and looked at in a headless Chromium, opened as files."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from docs.site import __main__ as site
from docs.site.stage import stage
from tests.lndrl.cli.reporting.chromium import AXE, CHROMIUM, QUIET, look

pytest.importorskip("zensical", reason="needs Zensical: pip install 'lndrl[docs]'")

KEPT = ("index.md", "tutorial.md", "training.md")
_SEARCH = """
<script>
function all(root, found = []) {
  for (const each of root.querySelectorAll("*")) {
    found.push(each);
    if (each.shadowRoot) all(each.shadowRoot, found);
  }
  return found;
}
const wait = ms => new Promise(done => setTimeout(done, ms));
addEventListener("load", async () => {
  await wait(1000);
  document.querySelector(".md-search__button").click();
  await wait(1000);
  const field = all(document).find(e => e.tagName === "INPUT" && e.type === "text");
  const value = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value");
  value.set.call(field, "discount");
  field.dispatchEvent(new Event("input", {bubbles: true, composed: true}));
  await wait(3000);
  const note = document.createElement("pre");
  note.id = "found";
  note.textContent = JSON.stringify(
    all(document).filter(e => e.tagName === "A" && e.getRootNode() !== document)
      .map(e => e.getAttribute("href")));
  document.body.append(note);
});
</script>
"""


def made(folder: Path, strictly: bool) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "zensical", "build", "--clean"]
    command += ["--strict"] if strictly else []
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The front page and two others; all of it takes ten seconds, and ``make check`` builds it."""
    folder = tmp_path_factory.mktemp("site")
    stage(folder / "pages")
    for page in (folder / "pages").rglob("*.md"):
        if page.relative_to(folder / "pages").as_posix() not in KEPT:
            page.unlink()
    for name in site.ASSETS:
        shutil.copy(site.CONFIG.with_name(name), folder / "pages")
    config = site.CONFIG.read_text()
    nav = ", ".join(f'{{ "{name}" = "{name}" }}' for name in KEPT)
    config = re.sub(r"^nav = \[.*?^\]", f"nav = [{nav}]", config, flags=re.DOTALL | re.MULTILINE)
    (folder / "zensical.toml").write_text(config)
    done = made(folder, strictly=False)
    assert done.returncode == 0, done.stderr
    site.keep_local(folder / "site")
    return folder / "site"


def test_links_and_anchors_that_lead_nowhere_end_the_build(tmp_path: Path) -> None:
    config = tomllib.loads(site.CONFIG.read_text())["project"]
    checks = "\n".join(f"{name} = {str(on).lower()}" for name, on in config["validation"].items())
    (tmp_path / "pages").mkdir()
    (tmp_path / "zensical.toml").write_text(
        '[project]\nsite_name = "a"\ndocs_dir = "pages"\nnav = ["index.md"]\n'
        f"[project.validation]\n{checks}\n"
    )
    (tmp_path / "pages/index.md").write_text(
        "# Here\n\n[a](#here), [b](#there), [c](other.md), in [−0.1, +0.2]\n"
    )
    done = made(tmp_path, strictly=True)
    assert done.returncode != 0
    said = re.sub(r"\x1b\[[\d;]*m", "", done.stdout + done.stderr)
    assert "2 issues found" in said and "there" in said and "other.md" in said


def test_pages_ask_nobody(built: Path, tmp_path: Path) -> None:
    scripts = [
        re.findall(r'<script[^>]*src="?([^"\s>]+)', p.read_text()) for p in built.glob("*.html")
    ]
    assert len(scripts) >= len(KEPT) and all(scripts)
    assert all("//" not in source for page in scripts for source in page)
    assert all(site.OFFLINE in page[0] for page in scripts)
    (tmp_path / "a.html").write_text('<link rel="stylesheet" href="https://fonts.example/a.css">')
    with pytest.raises(ValueError, match=r"a.html: would ask the network for https://fonts"):
        site.keep_local(tmp_path)


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (apt-get install chromium)")
@pytest.mark.parametrize(
    ("page", "width", "dark"),
    [
        *(("index.html", width, dark) for width in (390, 1440) for dark in (False, True)),
        ("training.html", 390, False),
    ],
)
def test_chromium_shows_it_whole(page: str, width: int, dark: bool, built: Path) -> None:
    found = look(built / page, built, width, dark, axe=bool(AXE))
    assert found["width"] == width and found["dark"] == dark
    assert (found["background"] == "rgb(255, 255, 255)") is not dark
    # What a frame, which the page is shown in here, may not do.
    console = [line for line in found["console"] if "Blocked autofocusing" not in line]
    assert console == [] and found["faults"] == []
    assert found["wide"] <= width
    assert found["images"] >= 1 and found["loaded"] == found["images"]
    serious = [each for each in found.get("axe", []) if each[0] in ("serious", "critical")]
    assert serious == []


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (apt-get install chromium)")
def test_the_search_works_in_pages_that_were_opened_as_files(built: Path, tmp_path: Path) -> None:
    probe = built / "probe.html"
    text = (built / "index.html").read_text()
    probe.write_text(text.replace("</head>", _SEARCH + "</head>", 1))
    command = [str(CHROMIUM), *QUIET, f"--user-data-dir={tmp_path}"]
    command += ["--virtual-time-budget=20000", "--dump-dom", probe.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    match = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert match is not None, done.stderr[-2000:]
    found: list[Any] = json.loads(html.unescape(match[1]))
    assert any("training.html" in link for link in found), found
