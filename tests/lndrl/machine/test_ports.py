"""Ports that are free, that the system gives to nobody else, and that come only once."""

from __future__ import annotations

import socket
from itertools import count
from pathlib import Path

import pytest

from lndrl.machine import ports
from lndrl.machine.ports import LOWEST, free_port


def give(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, text: str) -> None:
    """Let the system give out the ports of ``text``."""
    (tmp_path / "range").write_text(text)
    monkeypatch.setattr(ports, "_GIVEN_BY_THE_SYSTEM", tmp_path / "range")


def test_none_comes_twice_nor_from_the_systems_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    give(monkeypatch, tmp_path, "32768\t60999\n")
    found = [free_port() for _ in range(200)]
    assert len(set(found)) == 200
    assert all(LOWEST <= port < 32768 for port in found)


def test_a_port_that_is_taken_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ports, "_turns", count())
    taken = free_port()
    with socket.create_server(("127.0.0.1", taken)):
        monkeypatch.setattr(ports, "_turns", count())
        assert free_port() > taken or taken == 32767


def test_processes_begin_far_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ports, "_bound", lambda host, port: port)
    firsts = []
    for pid in range(1000, 1010):
        monkeypatch.setattr(ports.os, "getpid", lambda pid=pid: pid)
        monkeypatch.setattr(ports, "_turns", count())
        firsts.append(free_port())
    apart = [abs(one - other) for i, one in enumerate(firsts) for other in firsts[:i]]
    assert min(apart) >= ports.STRIDE


@pytest.mark.parametrize("text", ["1024 65535\n", f"{LOWEST} 60999\n"])
def test_without_room_the_system_is_asked(
    text: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    give(monkeypatch, tmp_path, text)
    asked: list[int] = []

    def bound(host: str, port: int) -> int:
        asked.append(port)
        return 40000

    monkeypatch.setattr(ports, "_bound", bound)
    assert free_port() == 40000 and asked == [0]


@pytest.mark.parametrize("text", ["", "many\n"])
def test_what_cannot_be_read_is_as_usual(
    text: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    give(monkeypatch, tmp_path, text)
    assert LOWEST <= free_port() < 32768
    monkeypatch.setattr(ports, "_GIVEN_BY_THE_SYSTEM", tmp_path / "nowhere")
    assert LOWEST <= free_port() < 32768


def test_an_address_of_others_has_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    give(monkeypatch, tmp_path, f"{LOWEST + 3} 60999\n")
    with pytest.raises(OSError):
        free_port("192.0.2.1")
