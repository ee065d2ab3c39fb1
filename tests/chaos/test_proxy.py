"""The proxy forwards, delays, stalls, cuts and mends."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from lndrl.chaos.proxy import Proxy

PATIENCE = 30.0


@pytest.fixture
def proxy() -> Iterator[Proxy]:
    """In front of a server that sends back what it gets."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        while True:
            try:
                connection, _ = server.accept()
            except OSError:
                return
            threading.Thread(target=echo, args=(connection,), daemon=True).start()

    threading.Thread(target=serve, daemon=True).start()
    proxy = Proxy(("127.0.0.1", server.getsockname()[1]))
    yield proxy
    proxy.close()
    server.close()


def echo(connection: socket.socket) -> None:
    with connection:
        try:
            while data := connection.recv(65536):
                connection.sendall(data)
        except OSError:
            return


def connect(proxy: Proxy) -> socket.socket:
    return socket.create_connection(("127.0.0.1", proxy.port), timeout=PATIENCE)


def settled(proxy: Proxy) -> None:
    """Wait until its thread has done what it was told, which it does in order."""
    done = threading.Event()
    proxy._call(done.set)
    assert done.wait(PATIENCE)


def receive(connection: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        piece = connection.recv(size - len(data))
        assert piece, "the connection ended"
        data += piece
    return data


def test_bytes_arrive_whole_and_in_order(proxy: Proxy) -> None:
    data = bytes(range(256)) * 8192
    with connect(proxy) as connection:
        threading.Thread(target=connection.sendall, args=(data,), daemon=True).start()
        assert receive(connection, len(data)) == data
    assert proxy.forwarded >= 2 * len(data)


def test_a_delay_holds_each_way_back(proxy: Proxy) -> None:
    proxy.delay(0.3)
    with connect(proxy) as connection:
        began = time.monotonic()
        connection.sendall(b"hello")
        assert receive(connection, 5) == b"hello"
        assert time.monotonic() - began >= 0.6


def test_a_stalled_connection_is_silent_and_goes_on(proxy: Proxy) -> None:
    with connect(proxy) as connection:
        connection.sendall(b"a")
        assert receive(connection, 1) == b"a"
        proxy.stall()
        settled(proxy)
        connection.sendall(b"b")
        connection.settimeout(0.5)
        with pytest.raises(TimeoutError):
            connection.recv(1)
        proxy.mend()
        connection.settimeout(PATIENCE)
        assert receive(connection, 1) == b"b"


def test_a_cut_ends_connections_and_refuses_new_ones_until_mended(proxy: Proxy) -> None:
    with connect(proxy) as connection:
        connection.sendall(b"a")
        assert receive(connection, 1) == b"a"
        proxy.cut()
        assert ended(connection)
    with connect(proxy) as connection:
        assert ended(connection)
    proxy.mend()
    with connect(proxy) as connection:
        connection.sendall(b"c")
        assert receive(connection, 1) == b"c"
    assert proxy.connections == 3


def ended(connection: socket.socket) -> bool:
    try:
        return connection.recv(1) == b""
    except ConnectionError:
        return True


def test_a_target_that_is_gone_ends_the_connection(proxy: Proxy) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        nobody = Proxy(("127.0.0.1", free.getsockname()[1]))
        try:
            with connect(nobody) as connection:
                assert ended(connection)
        finally:
            nobody.close()
            nobody.close()


def test_a_port_in_use_is_an_error(proxy: Proxy) -> None:
    with pytest.raises(OSError):
        Proxy(("127.0.0.1", 1), proxy.port)
