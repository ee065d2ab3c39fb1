"""Output that is not UTF-8: characters are replaced in every command, on terminals and in pipes."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
LOCALES = [
    {"PYTHONIOENCODING": "ascii"},
    {"PYTHONIOENCODING": "latin-1"},
    {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
]
# Every command's help, what lists and draws without a run, and what all others print with.
SCRIPT = """
import sys, time
from lndrl.cli.main import SUMMARIES, main

def run(*arguments):
    sys.argv = ["lndrl", *arguments]
    try:
        main()
    except SystemExit as end:
        if end.code not in (0, 2):
            raise

run("--help")
for name in SUMMARIES:
    run(name, "--help")
run("version")
run("scenarios")
run("evaluate", "w\\u00e4ldchen\\udcff")
run("dashboard", "--\\u2265")

from rich.console import Console
from rich.live import Live
from lndrl.transport.status import Status
from lndrl.cli.tables import print_tables
from lndrl.view.dashboard.screen import plain_line, render
from lndrl.view.progress import StatusLine, print_table, progress_bar, summary_table

rows = [{"m\\u00e9thod": "lndrl", "arrived": "0.52 \\u00b1 0.03"}]
print_tables(summary_table(rows, "\\u03c3 and \\u2265"))
print_table(rows)
for stream in (sys.stdout, sys.stderr):
    with progress_bar(3, "\\u2265 runs", "episodes", stream) as advance:
        advance(1, "\\u00b1")
    with StatusLine(stream=stream) as line:
        line.say("\\u2714 done")
        line.update("\\u2026")
status = Status(time=time.time(), steps=5, total_steps=10)
for _ in range(2):
    with Live(console=Console(), screen=False) as live:
        live.update(render(status, [], 100, 40), refresh=True)
print(plain_line(status), "\\u00b7", flush=True)
print("the end")
"""


def output_of(locale: dict[str, str], terminal: bool, folder: Path) -> tuple[int, bytes]:
    """Exit code, and all that is written to stdout and stderr."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("LC_", "LANG", "PYTHON"))}
    environment = {**kept, **locale, "PYTHONPATH": str(ROOT), "TERM": "xterm", "COLUMNS": "100"}
    command = [sys.executable, "-c", SCRIPT]
    if not terminal:
        done = subprocess.run(
            command, env=environment, capture_output=True, timeout=600, cwd=folder
        )
        return done.returncode, done.stdout + done.stderr
    ours, theirs = pty.openpty()
    with subprocess.Popen(command, env=environment, stdout=theirs, stderr=theirs, cwd=folder) as it:
        os.close(theirs)
        written = b""
        while True:
            try:
                piece = os.read(ours, 65536)
            except OSError:
                break
            if not piece:
                break
            written += piece
    os.close(ours)
    return it.returncode, written


@pytest.mark.parametrize("terminal", [False, True], ids=["pipe", "terminal"])
@pytest.mark.parametrize("locale", LOCALES, ids=["ascii", "latin-1", "C"])
def test_nothing_that_is_printed_ends_in_a_traceback(
    locale: dict[str, str], terminal: bool, tmp_path: Path
) -> None:
    code, written = output_of(locale, terminal, tmp_path)
    assert b"Traceback" not in written, written[-3000:].decode("latin-1")
    assert code == 0 and b"the end" in written
    if "latin-1" not in locale.values():
        assert written.isascii()


def test_files_are_utf8_whatever_the_locale(tmp_path: Path) -> None:
    script = f"""
from pathlib import Path
from lndrl.config import load_config
from learner.run.folder import RunFolder
from lndrl.models import load_yaml
path = Path("place.yaml")
path.write_bytes("scenario: corridor\\nnote: \\u03c3 \\u2265 0\\n".encode())
assert load_yaml(path)["note"] == "\\u03c3 \\u2265 0"
config = load_config(Path("{ROOT}/configs/lndrl.yaml"), [])
scenario = config.scenario.model_copy(update={{"description": "\\u03c3"}})
RunFolder.create(Path("run"), config.model_copy(update={{"scenario": scenario}}))
assert load_config(Path("run/config.yaml")).scenario.description == "\\u03c3"
"""
    for locale in LOCALES:
        folder = tmp_path / "-".join(locale.values())
        folder.mkdir()
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("LC_", "LANG", "PYTHON"))}
        done = subprocess.run(
            [sys.executable, "-c", script],
            env={**kept, **locale, "PYTHONPATH": str(ROOT)},
            capture_output=True, text=True, encoding="utf-8", timeout=600, cwd=folder,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
