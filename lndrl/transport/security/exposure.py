"""Endpoints in zenoh's settings: how they read, whether they exist here, and who reaches them."""

from __future__ import annotations

import ipaddress
import re
import socket
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from lndrl.errors import UserError
from lndrl.transport.security.identity import is_loopback

NETWORK = ("tcp", "tls", "udp", "quic", "ws")
"""What goes to HOST:PORT."""
SOCKET_FILE = "unixsock-stream"
"""Goes to a file that only this machine has; its permissions say who may."""
PROTOCOLS = (*NETWORK, SOCKET_FILE)
"""What zenoh's Python package speaks."""
LOOPBACK_INTERFACE = "lo"


class UnknownHostError(UserError):
    """A host name has no address, here and now."""


@dataclass(frozen=True)
class Endpoint:
    """An endpoint as zenoh reads it, ``SCHEME/ADDRESS[?METADATA][#CONFIG]``."""

    text: str
    scheme: str
    host: str
    """Empty where the scheme is none of NETWORK."""
    port: str
    interface: str
    """The network interface that ``#iface=`` binds it to; empty for any."""

    @property
    def is_local(self) -> bool:
        """Whether only this machine can come in."""
        if self.scheme == SOCKET_FILE or self.interface == LOOPBACK_INTERFACE:
            return True
        return is_loopback(self.host)


def read_endpoint(text: str) -> Endpoint:
    """What ``text`` says; raises UserError with what would be right."""
    scheme, slash, rest = text.partition("/")
    if not slash or scheme not in PROTOCOLS:
        raise UserError(f"endpoint {text}: must begin with {', '.join(f'{p}/' for p in PROTOCOLS)}")
    address = re.split(r"[?#]", rest)[0]
    options = dict(part.partition("=")[::2] for part in rest.partition("#")[2].split(";"))
    host = port = ""
    if scheme in NETWORK:
        host, _, port = address.rpartition(":")
        if not host or not port.isdecimal() or int(port) > 65535:
            raise UserError(
                f"endpoint {text}: needs a host and a port up to 65535, like {scheme}/HOST:PORT"
            )
    elif not address:
        raise UserError(f"endpoint {text}: needs a file, like {scheme}//tmp/lndrl.sock")
    return Endpoint(text, scheme, host, port, options.get("iface", ""))


def endpoints_of(settings: Mapping[str, Any], side: str) -> Iterator[str]:
    """Every endpoint of ``listen`` or ``connect``: a word, a list, groups, or those per mode."""
    yield from _words((settings.get(side) or {}).get("endpoints") or [])


def _words(found: Any) -> Iterable[str]:
    if isinstance(found, str):
        yield found
    elif isinstance(found, Mapping):
        # Per mode, or a group that has a strategy beside its endpoints.
        for key, value in found.items():
            if key != "strategy":
                yield from _words(value)
    elif isinstance(found, list):
        for value in found:
            yield from _words(value)


def check_exposure(settings: Mapping[str, Any], insecure: bool) -> None:
    """Raises UserError where ``settings`` (nested, complete) listen unprotected beyond loopback.

    Protected is what is encrypted and asks who comes: TLS with client certificates or users.
    """
    transport = settings.get("transport", {})
    tls = transport.get("link", {}).get("tls", {})
    users = transport.get("auth", {}).get("usrpwd", {}).get("dictionary_file")
    for endpoint in map(read_endpoint, endpoints_of(settings, "listen")):
        encrypted = endpoint.scheme in ("tls", "quic") and tls.get("listen_certificate")
        protected = encrypted and (tls.get("enable_mtls") or users)
        if insecure or endpoint.is_local or protected:
            continue
        where = f" on the network of {endpoint.interface}" if endpoint.interface else ""
        raise UserError(
            f"endpoint {endpoint.text} is open to other machines and not protected{where}; use"
            f" --certs FOLDER with tls/{endpoint.host}:{endpoint.port}, listen on 127.0.0.1, or"
            " accept that with --insecure"
        )


def check_interfaces(settings: Mapping[str, Any]) -> None:
    """Raises UserError for an endpoint of a network interface that this machine does not have."""
    here = [name for _, name in socket.if_nameindex()]
    for side in ("listen", "connect"):
        for endpoint in map(read_endpoint, endpoints_of(settings, side)):
            if endpoint.interface and endpoint.interface not in here:
                raise UserError(
                    f"endpoint {endpoint.text}: this machine has no network interface"
                    f" {endpoint.interface}; it has {', '.join(here)}"
                )


def check_hosts(settings: Mapping[str, Any]) -> None:
    """Raises UnknownHostError for a host name that has no address.

    zenoh itself would try again and again, and say in the end that nobody answered. May take as
    long as the resolver takes.
    """
    for side in ("listen", "connect"):
        for endpoint in map(read_endpoint, endpoints_of(settings, side)):
            _check_host(endpoint)


def _check_host(endpoint: Endpoint) -> None:
    if not endpoint.host or _is_address(endpoint.host):
        return
    try:
        socket.getaddrinfo(endpoint.host, endpoint.port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or "it is no name of a host"
        raise UnknownHostError(
            f"endpoint {endpoint.text}: the host name {endpoint.host} is unknown here ({why});"
            " correct it, or use the address"
        ) from None


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return False
    return True


def reachable(endpoint: str, host: str = "") -> str:
    """Where ``host``, by default this machine, reaches a learner that listens at ``endpoint``.

    No certificate is for 0.0.0.0 or [::], and zenoh reaches no IPv6 address over TLS.
    """
    any_ipv6 = "/localhost:" if endpoint.startswith("tls/") else "/[::1]:"
    here = endpoint if host else endpoint.replace("/[::]:", any_ipv6)
    place = f"/{host or '127.0.0.1'}:"
    return here.replace("/0.0.0.0:", place).replace("/[::]:", place)
