"""What the exit codes of ``lndrl`` mean: one table, which the help and the pages show."""

from __future__ import annotations

EXIT_CODES = {
    0: "done",
    1: "the work failed, or what was checked is not as it should be",
    2: "the input must be mended; one sentence says what",
    129: "the terminal was closed (SIGHUP)",
    130: "interrupted by Ctrl-C (SIGINT)",
    143: "asked to end (SIGTERM)",
}
"""Code to meaning. From 128 on it is that and the signal's number, as shells have it."""


def exit_code_lines() -> list[str]:
    """A line per code, as a help page shows them."""
    return [f"{code:>4}  {meaning}" for code, meaning in EXIT_CODES.items()]
