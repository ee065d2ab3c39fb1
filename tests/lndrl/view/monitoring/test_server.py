"""The endpoint that Prometheus asks: what it serves, and that nobody can keep it busy."""

from __future__ import annotations

import socket
import time
import urllib.request
from collections.abc import Iterator

import pytest
from prometheus_client import CollectorRegistry, Gauge

from lndrl.errors import UserError
from lndrl.machine.ports import free_port
from lndrl.view.monitoring import MetricsServer, server


def scraped(url: str) -> str:
    with urllib.request.urlopen(url, timeout=20.0) as answer:
        text: str = answer.read().decode()
    return text


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[MetricsServer]:
    monkeypatch.setattr(server._Handler, "timeout", 0.3)
    registry = CollectorRegistry()
    Gauge("lndrl_test_seconds", "A number.", registry=registry).set(7)
    made = MetricsServer("127.0.0.1", free_port(), registry)
    made.start()
    yield made
    made.close()


def test_what_is_registered_is_served_to_all_who_ask_in_turn(served: MetricsServer) -> None:
    began = time.monotonic()
    for _ in range(8):
        assert "lndrl_test_seconds 7.0" in scraped(served.url).splitlines()
    assert time.monotonic() - began > 6 * server._PAUSE, "a flood is answered slowly"


def test_who_says_nothing_does_not_keep_others_waiting_for_ever(served: MetricsServer) -> None:
    silent = socket.create_connection(("127.0.0.1", int(served.url.split(":")[2].split("/")[0])))
    try:
        assert "lndrl_test_seconds 7.0" in scraped(served.url)
    finally:
        silent.close()


def test_a_port_that_is_taken_is_one_sentence(served: MetricsServer) -> None:
    port = int(served.url.split(":")[2].split("/")[0])
    with pytest.raises(UserError) as raised:
        MetricsServer("127.0.0.1", port, CollectorRegistry(), "--metrics-port")
    said = f"--metrics-port {port}: cannot listen at 127.0.0.1 (Address already in use)"
    assert str(raised.value) == said


@pytest.mark.parametrize("address", ["no.such.host.invalid", "300.1.1.1", "192.0.2.1", "a..b"])
def test_an_address_that_is_not_here_is_one_sentence(address: str) -> None:
    with pytest.raises(UserError, match=f"cannot listen at {address} \\("):
        MetricsServer(address, free_port(), CollectorRegistry())


def test_ports_are_given_back_also_by_who_never_started() -> None:
    port = free_port()
    for _ in range(2):
        MetricsServer("127.0.0.1", port, CollectorRegistry()).close()
