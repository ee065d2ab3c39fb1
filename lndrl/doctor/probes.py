"""Questions to a port, below zenoh: does the name exist, does anybody listen, is it TLS.

TLS is asked with Python's own ssl module, because zenoh reports every failure as "unable to
connect".
"""

from __future__ import annotations

import contextlib
import ipaddress
import re
import socket
import ssl
import threading
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

from lndrl.errors import UserError

OK, FAILED, SKIPPED = "ok", "failed", "skipped"
ENDPOINT = re.compile(r"(tcp|tls)/(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9_.\-]+):(\d{1,5})\Z")
# In TLS 1.3 the refusal of a client's certificate comes after the client's handshake is done.
REFUSAL_SECONDS = 1.0
WRONG_NAME = (62, 64)
EXPIRED, NOT_YET_VALID, WRONG_PURPOSE = 10, 9, 26
OTHER_AUTHORITY = (2, 7, 18, 19, 20, 21)
T = TypeVar("T")


@dataclass(frozen=True)
class Check:
    """One step of a diagnosis. ``state`` is ok, failed or skipped; ``text`` one sentence."""

    name: str
    state: str
    text: str


@dataclass(frozen=True)
class Address:
    """An endpoint taken apart; ``host`` without brackets."""

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        return self.written(self.scheme)

    def written(self, scheme: str) -> str:
        """As an endpoint of ``scheme``."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{scheme}/{host}:{self.port}"


def parse_address(endpoint: str) -> Address:
    """The parts of ``tcp/HOST:PORT`` or ``tls/HOST:PORT``; raises UserError."""
    match = ENDPOINT.match(endpoint)
    if match is None or not 0 < int(match[3]) < 65536:
        raise UserError(
            f"{endpoint!r} is no endpoint; write tcp/HOST:PORT or tls/HOST:PORT with a port from"
            " 1 to 65535, e.g. tcp/127.0.0.1:7447"
        )
    return Address(match[1], match[2].strip("[]"), int(match[3]))


def check_name(address: Address, timeout: float) -> Check:
    """Whether the host has an address; waits at most ``timeout`` seconds."""
    host = address.host
    try:
        ipaddress.ip_address(host)
        return Check("name", OK, f"{host} is an address")
    except ValueError:
        pass
    try:
        found = _bounded(lambda: socket.getaddrinfo(host, None, type=socket.SOCK_STREAM), timeout)
    except TimeoutError:
        text = f"the name service did not answer for {host} within {timeout:g} s"
        return Check("name", FAILED, f"{text}; use the address instead of the name")
    except (OSError, UnicodeError):
        text = f"the host name {host} is unknown here; correct it, or use the address"
        return Check("name", FAILED, text)
    addresses = ", ".join(dict.fromkeys(str(entry[4][0]) for entry in found))
    return Check("name", OK, f"{host} is {addresses}")


def check_port(address: Address, timeout: float) -> Check:
    """Whether somebody accepts TCP connections there."""
    try:
        with socket.create_connection((address.host, address.port), timeout):
            return Check("tcp", OK, f"port {address.port} accepts connections")
    except ConnectionRefusedError:
        text = (
            f"nobody listens on port {address.port} of {address.host}; start the learner there"
            f" with --listen {address.scheme}/0.0.0.0:{address.port} (without --listen it accepts"
            " its own machine only), or correct the port"
        )
    except TimeoutError:
        text = (
            f"{address.host} did not answer within {timeout:g} s; it is off, or a firewall drops"
            f" port {address.port}"
        )
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        text = f"{address.host} cannot be reached ({reason}); check the address and the network"
    return Check("tcp", FAILED, text)


def speaks_tls(address: Address, timeout: float) -> bool:
    """Whether the port answers a TLS handshake, whoever it says it is."""
    try:
        with _handshake(address, _trusting(), timeout):
            return True
    except ssl.SSLError as error:
        return "ALERT" in (error.reason or "")
    except OSError:
        return False


def check_tls(
    address: Address, folder: Path | None, role: str | None, timeout: float, name: str = "tls"
) -> Check:
    """Whether the port and we believe each other's certificates.

    ``folder`` holds ca.pem and, for ``role``, a certificate and key that fit; None shows none.
    """
    context = _trusting()
    if folder is not None:
        try:
            context = ssl.create_default_context(cafile=str(folder / "ca.pem"))
        except (OSError, ssl.SSLError):
            return Check(name, SKIPPED, f"{folder}/ca.pem cannot be used")
        if role is not None:
            context.load_cert_chain(folder / f"{role}.pem", folder / f"{role}.key", password="")
    try:
        with _handshake(address, context, timeout) as stream:
            version = stream.version()
            if folder is not None and not _await_refusal(stream):
                text = "the learner ended the connection after the handshake; look at its log"
                return Check(name, FAILED, text)
    except ssl.SSLCertVerificationError as error:
        return Check(name, FAILED, _unbelieved(error, address, folder or Path(), timeout))
    except ssl.SSLError as error:
        return Check(name, FAILED, _refused(error.reason or "", address, folder, role))
    except OSError:
        return Check(name, FAILED, _not_tls(address))
    if folder is None:
        text = (
            "the learner speaks TLS, but nothing here says whom to believe; give --certs FOLDER"
            " with the ca.pem that `lndrl certs` made"
        )
        return Check(name, FAILED, text)
    shown = f"{role}.pem" if role is not None else "no certificate of ours"
    return Check(name, OK, f"{version}, the learner is believed and takes {shown}")


def _unbelieved(
    error: ssl.SSLCertVerificationError, address: Address, folder: Path, timeout: float
) -> str:
    """Why we do not believe the learner's certificate."""
    code = error.verify_code
    clock = f"this machine's clock says {datetime.now(UTC):%Y-%m-%d %H:%M} UTC"
    if code == EXPIRED:
        return (
            "the learner's certificate has expired; make a new one with `lndrl certs --out FOLDER"
            f" --renew learner`, copy it there and start the learner again ({clock})"
        )
    if code == NOT_YET_VALID:
        return f"the learner's certificate is not yet valid; set the clocks right ({clock})"
    if code in WRONG_NAME:
        names = ", ".join(_shown_names(address, timeout)) or "no host"
        return (
            f"the learner's certificate is not made for {address.host} but for {names}; connect"
            f" to one of these, or `lndrl certs --out FOLDER --renew learner --host {address.host}`"
        )
    if code in OTHER_AUTHORITY:
        return (
            f"the learner's certificate is of another authority than {folder / 'ca.pem'}; copy"
            " ca.pem from the folder that the learner's certificate was made in"
        )
    if code == WRONG_PURPOSE:
        return (
            "what listens there shows a certificate that is no learner's; whoever runs it, it is"
            " not the learner: give it learner.pem or correct the endpoint"
        )
    return f"the learner's certificate cannot be believed ({error.verify_message})"


def _refused(reason: str, address: Address, folder: Path | None, role: str | None) -> str:
    """Why the learner does not believe us, from its alert."""
    if "ALERT" not in reason:
        return _not_tls(address)
    if role is None:
        where = folder or "FOLDER"
        return (
            "the learner wants a certificate and none that can be used was given; give --certs"
            f" {where} with ROLE.pem and ROLE.key that `lndrl certs` made"
        )
    ours = f"{folder}/{role}.pem"
    if "UNKNOWN_CA" in reason or "DECRYPT_ERROR" in reason:
        return (
            f"the learner refuses {ours}: it is of another authority than the learner's; make"
            " both in one folder of `lndrl certs`"
        )
    if "EXPIRED" in reason:
        return (
            f"the learner refuses {ours}: it has expired by the learner's clock; make a new one"
            f" with `lndrl certs --out FOLDER --renew {role}`"
        )
    return f"the learner refuses {ours} ({reason.lower().replace('_', ' ')}); make a new one"


def _not_tls(address: Address) -> str:
    return (
        f"port {address.port} does not speak TLS; if the learner listens without it, write"
        f" {address.written('tcp')}, else start it with --listen {address.written('tls')}"
    )


def _shown_names(address: Address, timeout: float) -> list[str]:
    from cryptography import x509

    from lndrl.transport.security.certificates import host_names

    with (
        contextlib.suppress(OSError, ValueError),
        _handshake(address, _trusting(), timeout) as stream,
    ):
        return host_names(x509.load_der_x509_certificate(stream.getpeercert(True) or b""))
    return []


def _trusting() -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def _handshake(address: Address, context: ssl.SSLContext, timeout: float) -> ssl.SSLSocket:
    raw = socket.create_connection((address.host, address.port), timeout)
    try:
        return context.wrap_socket(raw, server_hostname=address.host)
    except BaseException:
        raw.close()
        raise


def _await_refusal(stream: ssl.SSLSocket) -> bool:
    """False when the other side hangs up, raises SSLError when it refuses, True for silence."""
    stream.settimeout(REFUSAL_SECONDS)
    try:
        return stream.recv(1) != b""
    except TimeoutError:
        return True


def _bounded(work: Callable[[], T], timeout: float) -> T:
    """The result of ``work``; TimeoutError after ``timeout`` s, the work is left behind then."""
    result: list[Any] = []

    def run() -> None:
        try:
            result.append(work())
        except Exception as error:
            result.append(error)

    thread = threading.Thread(target=run, name="lndrl-doctor", daemon=True)
    thread.start()
    thread.join(timeout)
    if not result:
        raise TimeoutError
    if isinstance(result[0], Exception):
        raise result[0]
    return result[0]
