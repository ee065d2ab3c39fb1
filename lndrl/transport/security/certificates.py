"""A certificate authority of one's own and a certificate per role, for TLS on both sides.

ECDSA on P-256: zenoh's rustls and Python's ssl both take it. A role's name is the certificate's
common name, which zenoh's access control reads. Only those of the learner and of a site's door may
serve and carry host names (RFC 6125), so nobody can pose as one with an actor's certificate.
"""

from __future__ import annotations

import ipaddress
import os
import re
import secrets
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from lndrl.errors import UserError

ROLES = ("learner", "actor", "dashboard", "evaluator", "operator", "site")
SERVING = ("learner", "site")
"""Roles that others connect to: their certificates carry names."""
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
DEFAULT_DAYS = 365
CA_DAYS = 3650
# Certificates are valid from a day ago, because clocks of machines without network time differ.
CLOCK_SKEW = timedelta(days=1)
LABEL = re.compile(r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)\Z")


@dataclass(frozen=True)
class Authority:
    """The certificate that all others are checked with, and the key that signs them."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def common_name(role: str) -> str:
    """The name in the certificate of a role."""
    return f"lndrl-{role}"


def create(
    folder: Path,
    hosts: Sequence[str],
    days: int = DEFAULT_DAYS,
    now: datetime | None = None,
    site_hosts: Sequence[str] = (),
) -> dict[str, datetime]:
    """Write ca and one certificate with key per role; returns the end of each one's validity.

    ``hosts`` are names and addresses by which others reach the learner, ``site_hosts`` those of
    the doors of sites; ``days`` is the validity of the roles. Raises UserError when one of the
    files exists, nothing is written then.
    """
    now = now or datetime.now(UTC)
    names = {"learner": learner_hosts(hosts), "site": learner_hosts(site_hosts, "--site-host")}
    taken = [name for name in _file_names() if (folder / name).exists()]
    if taken:
        raise UserError(
            f"{folder} already holds {', '.join(taken)}, and certificates are never overwritten;"
            " name another folder, or use --renew ROLE for new ones of the same authority"
        )
    authority = _new_authority(now)
    files = {
        "ca.pem": _pem(authority.certificate),
        "ca.key": _key_pem(authority.key),
    }
    ends = {}
    for role in ROLES:
        certificate, key = _issue(authority, role, names.get(role, []), days, now)
        files |= {f"{role}.pem": _pem(certificate), f"{role}.key": _key_pem(key)}
        ends[role] = certificate.not_valid_after_utc
    _write_new(folder, files)
    return ends


def renew(
    folder: Path,
    roles: Iterable[str],
    hosts: Sequence[str] = (),
    days: int = DEFAULT_DAYS,
    now: datetime | None = None,
    site_hosts: Sequence[str] = (),
) -> dict[str, datetime]:
    """Replace certificate and key of ``roles`` with new ones of the authority in ``folder``.

    Without ``hosts`` the learner's keeps its names, without ``site_hosts`` a site's. Raises
    UserError where the authority is missing, damaged or expired.
    """
    now = now or datetime.now(UTC)
    roles = check_roles(roles)
    authority = _load_authority(folder, now)
    ends = {}
    for role in roles:
        given = {"learner": hosts, "site": site_hosts}.get(role, ())
        names = _names_for(folder, role, given) if role in SERVING else []
        certificate, key = _issue(authority, role, names, days, now)
        _replace(folder / f"{role}.key", _key_pem(key))
        _replace(folder / f"{role}.pem", _pem(certificate))
        ends[role] = certificate.not_valid_after_utc
    return ends


def check_roles(roles: Iterable[str]) -> list[str]:
    """``roles`` without repetition; raises UserError for one that does not exist."""
    found = list(dict.fromkeys(roles))
    for role in found:
        if role not in ROLES:
            raise UserError(f"role {role!r} is unknown; roles are {', '.join(ROLES)}")
    return found


def learner_hosts(hosts: Sequence[str], option: str = "--host") -> list[str]:
    """``hosts`` and this machine's own names, without repetition.

    Raises UserError for what is neither a host name nor an address.
    """
    return list(dict.fromkeys([_host(host, option) for host in hosts] + list(LOCAL_HOSTS)))


def host_names(certificate: x509.Certificate) -> list[str]:
    """Names and addresses that a certificate is made for."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    addresses = [str(address) for address in names.get_values_for_type(x509.IPAddress)]
    return list(names.get_values_for_type(x509.DNSName)) + addresses


def load_certificate(file: Path) -> x509.Certificate:
    """The certificate in ``file``; raises UserError when there is none."""
    try:
        return x509.load_pem_x509_certificate(file.read_bytes())
    except OSError as error:
        raise UserError(f"{file}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise UserError(f"{file}: is not a certificate in PEM format") from None


def load_key(file: Path) -> ec.EllipticCurvePrivateKey:
    """The private key in ``file``; raises UserError when there is none of ours."""
    try:
        key = serialization.load_pem_private_key(file.read_bytes(), password=None)
    except OSError as error:
        raise UserError(f"{file}: cannot be read ({error.strerror})") from None
    except (ValueError, TypeError):
        raise UserError(f"{file}: is not a private key in PEM format without password") from None
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise UserError(f"{file}: is not a key on an elliptic curve, as `lndrl certs` makes it")
    return key


def _host(host: str, option: str) -> str:
    try:
        address = ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        pass
    else:
        if "%" not in str(address):
            return str(address)
    labels = host.removesuffix(".").split(".")
    # A name that ends in a number would be read as an address by some and refused by rustls.
    if len(host) > 253 or not all(map(LABEL.match, labels)) or labels[-1].isdecimal():
        raise UserError(
            f"{option} {host}: neither a host name nor an address;"
            " write it like robot.lab or 192.168.1.5, without port"
        )
    return host.removesuffix(".").lower()


def _names_for(folder: Path, role: str, hosts: Sequence[str]) -> list[str]:
    if hosts:
        return learner_hosts(hosts, "--host" if role == "learner" else "--site-host")
    old = folder / f"{role}.pem"
    return host_names(load_certificate(old)) if old.exists() else learner_hosts([])


def _file_names() -> list[str]:
    return [f"{name}.{kind}" for name in ("ca", *ROLES) for kind in ("pem", "key")]


def _new_authority(now: datetime) -> Authority:
    key = ec.generate_private_key(ec.SECP256R1())
    # With a name of its own, another authority's certificate reads "unknown", not "damaged".
    name = _subject(f"lndrl-ca-{secrets.token_hex(4)}")
    certificate = (
        _builder(name, name, key.public_key(), now, now + timedelta(days=CA_DAYS))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    return Authority(certificate, key)


def _load_authority(folder: Path, now: datetime) -> Authority:
    for name in ("ca.pem", "ca.key"):
        if not (folder / name).exists():
            raise UserError(
                f"{folder} holds no {name}; renew in the folder where `lndrl certs` first ran,"
                " or make a new authority in an empty one"
            )
    authority = Authority(load_certificate(folder / "ca.pem"), load_key(folder / "ca.key"))
    if authority.certificate.public_key() != authority.key.public_key():
        raise UserError(f"{folder}: ca.key does not belong to ca.pem; bring the two that do")
    if authority.certificate.not_valid_after_utc <= now:
        raise UserError(f"{folder}: ca.pem has expired; make a new authority in an empty folder")
    return authority


def _issue(
    authority: Authority, role: str, hosts: Sequence[str], days: int, now: datetime
) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    key = ec.generate_private_key(ec.SECP256R1())
    issuer = authority.certificate
    end = min(now + timedelta(days=days), issuer.not_valid_after_utc)
    builder = (
        _builder(_subject(common_name(role)), issuer.subject, key.public_key(), now, end)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key()),
            critical=False,
        )
    )
    purposes = [ExtendedKeyUsageOID.CLIENT_AUTH]
    if role in SERVING:
        purposes.append(ExtendedKeyUsageOID.SERVER_AUTH)
        names = x509.SubjectAlternativeName([_general_name(host) for host in hosts])
        builder = builder.add_extension(names, critical=False)
    builder = builder.add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
    return builder.sign(authority.key, hashes.SHA256()), key


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey,
    now: datetime,
    end: datetime,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_SKEW)
        .not_valid_after(end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _usage(signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def _write_new(folder: Path, files: dict[str, bytes]) -> None:
    written: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            _write(folder / name, data)
            written.append(folder / name)
    except OSError as error:
        for file in written:
            file.unlink(missing_ok=True)
        raise UserError(f"{folder}: cannot be written ({error.strerror})") from None


def _replace(file: Path, data: bytes) -> None:
    fresh = file.with_name(f".{file.name}.new")
    try:
        fresh.unlink(missing_ok=True)
        _write(fresh, data)
        os.replace(fresh, file)
    except OSError as error:
        raise UserError(f"{file}: cannot be written ({error.strerror})") from None


def _write(file: Path, data: bytes) -> None:
    # O_EXCL: never through another's link, and a key is at no moment readable by others.
    mode = 0o600 if file.name.removesuffix(".new").endswith(".key") else 0o644
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as out:
        out.write(data)
