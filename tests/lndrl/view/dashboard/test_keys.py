from __future__ import annotations

import io
import os
from collections.abc import Iterator

import pytest

from lndrl.view.dashboard.keys import Keys, key_presses

termios = pytest.importorskip("termios")


@pytest.fixture
def pipe() -> Iterator[tuple[Keys, int]]:
    theirs, ours = os.pipe()
    with os.fdopen(theirs) as stream:
        yield Keys(stream), ours
    os.close(ours)


def all_keys(keys: Keys) -> list[str]:
    found = []
    while key := keys.pressed(0.0):
        found.append(key)
    return found


def test_keys_have_names(pipe: tuple[Keys, int]) -> None:
    keys, ours = pipe
    os.write(ours, "qé\t\r\x7f\x1b[A\x1bOB\x1b[5~\x1b[Z".encode())
    names = ["q", "é", "tab", "enter", "backspace", "up", "down", "pageup", "shift-tab"]
    assert all_keys(keys) == names


def test_unknown_sequences_are_swallowed_whole(pipe: tuple[Keys, int]) -> None:
    keys, ours = pipe
    os.write(ours, b"\x1b[1;5Pa\x1b]11;rgb:00/11/22\x07b\x1b[?62;4cc\x1b[200~d\x01")
    assert all_keys(keys) == ["a", "b", "c", "d"]


def test_escape_is_an_esc_that_nothing_follows(pipe: tuple[Keys, int]) -> None:
    keys, ours = pipe
    os.write(ours, b"\x1b")
    assert keys.pressed(0.0) == "escape"
    os.write(ours, b"\x1b[")
    assert keys.pressed(0.0) == "", "half a sequence is no key"
    os.write(ours, b"s")
    assert keys.pressed(0.0) == "s"


def test_letters_in_two_halves(pipe: tuple[Keys, int]) -> None:
    keys, ours = pipe
    os.write(ours, b"\xc3")
    assert keys.pressed(0.0) == ""
    os.write(ours, b"\xa9")
    assert keys.pressed(0.0) == "é"


def test_a_stream_that_ends_has_no_keys() -> None:
    theirs, ours = os.pipe()
    os.close(ours)
    with os.fdopen(theirs) as stream:
        keys = Keys(stream)
        assert keys.pressed(0.0) == ""
        assert not keys.listening


def test_without_a_terminal_nothing_is_read() -> None:
    stream = io.StringIO("q")
    with key_presses(stream) as keys:
        assert keys.pressed(0.0) == "" and not keys.listening
    theirs, ours = os.pipe()
    os.write(ours, b"q")
    with os.fdopen(theirs) as piped, key_presses(piped) as keys:
        assert keys.pressed(0.0) == ""
        assert piped.read(1) == "q"
    os.close(ours)
