"""Pages in a headless Chromium: what it says of them."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
AXE = os.environ.get("AXE_CORE", "")
"""axe.min.js of axe-core (npm pack axe-core), where it is there."""
QUIET = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --hide-scrollbars"
    " --disable-background-networking --disable-component-update --disable-sync"
    " --disable-dev-shm-usage --enable-logging=stderr"
).split()

# Tells what it finds to the page around it; the page itself has no script.
_LOOK = """
<script>window.faults = []; addEventListener("error", e => faults.push(String(e.message)));</script>
AXE
<script>
addEventListener("load", async () => {
  for (const each of document.querySelectorAll("details")) each.open = true;
  const root = document.documentElement, seen = [...document.images];
  const drawn = [...document.querySelectorAll("svg")].map(s => s.getBoundingClientRect());
  const found = {
    faults, width: innerWidth, wide: root.scrollWidth, images: seen.length,
    loaded: seen.filter(i => i.complete && i.naturalWidth > 0).length,
    charts: drawn.length, drawn: drawn.filter(b => b.width > 100 && b.height > 50).length,
    dark: matchMedia("(prefers-color-scheme: dark)").matches,
    background: getComputedStyle(document.body).backgroundColor,
    outside: [...document.querySelectorAll("main *")].filter(e =>
      !e.closest(".scroll, .frame, pre") && e.getBoundingClientRect().right > innerWidth + 1
    ).map(e => e.tagName + "." + e.className),
  };
  if (window.axe) {
    const rules = {resultTypes: ["violations"], preload: false};
    found.axe = (await axe.run(document, rules)).violations.map(v =>
      [v.impact, v.id, v.nodes.length, v.nodes[0].html.slice(0, 160)]);
  }
  parent.postMessage(JSON.stringify(found), "*");
});
</script>
"""
# A window is never narrower than 500 pixels, a frame within is.
_FRAME = """<!DOCTYPE html>
<meta name="color-scheme" content="light dark">
<iframe src="PAGE" style="border: 0; width: WIDTHpx; height: 900px"></iframe>
<script>
addEventListener("message", event => {
  const note = document.createElement("pre");
  note.id = "found"; note.textContent = event.data;
  document.body.append(note);
});
</script>
"""


def look(page: Path, folder: Path, width: int, dark: bool, axe: bool = False) -> dict[str, Any]:
    """What Chromium finds in ``page``, ``width`` pixels wide; ``console``: what it complains of."""
    script = f"<script>{Path(AXE).read_text(encoding='utf-8')}</script>" if axe else ""
    copy = folder / f"{page.stem}-{width}-{dark}.html"
    text = page.read_text(encoding="utf-8")
    # Not by sub, to which a backslash of the script would mean something.
    copy.write_text(text.replace("</head>", _LOOK.replace("AXE", script) + "</head>", 1), "utf-8")
    frame = copy.with_suffix(".frame.html")
    inside = _FRAME.replace("PAGE", copy.as_uri()).replace("WIDTH", str(width))
    frame.write_text(inside, encoding="utf-8")
    command = [
        str(CHROMIUM),
        *QUIET,
        f"--user-data-dir={folder / f'profile-{page.stem}-{width}-{dark}'}",
        f"--window-size={width + 200},1000",
        f"--blink-settings=preferredColorScheme={0 if dark else 1}",
        "--virtual-time-budget=20000",
        "--dump-dom",
        frame.as_uri(),
    ]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=300)
    match = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert match is not None, done.stderr[-2000:]
    found: dict[str, Any] = json.loads(html.unescape(match[1]))
    found["console"] = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    return found
