"""Whether the certificate files of a role are all there, fit each other and are still valid."""

from __future__ import annotations

import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.x509.oid import NameOID

from lndrl.doctor.probes import FAILED, OK, Check
from lndrl.errors import UserError
from lndrl.transport.security.certificates import ROLES, common_name, load_certificate
from lndrl.wording import counted

SOON = timedelta(days=30)


def roles_in(folder: Path) -> tuple[str, ...]:
    """The roles that have a certificate in ``folder``."""
    return tuple(role for role in ROLES if (folder / f"{role}.pem").exists())


def name_shown(folder: Path, role: str) -> str | None:
    """Whom the role's certificate names, whatever its file is called; None if it cannot be read."""
    try:
        return _name(load_certificate(folder / f"{role}.pem"))
    except UserError:
        return None


def _name(certificate: x509.Certificate) -> str:
    """What access control goes by."""
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value) if names else "nobody"


def check_files(
    folder: Path, role: str | None, now: datetime | None = None, name: str = "certificates"
) -> tuple[Check, bool]:
    """What is wrong with ca.pem and the files of ``role``; and whether TLS can use the latter."""
    now = now or datetime.now(UTC)
    try:
        authority = _authority(folder, now)
        if role is None:
            text = f"{folder} has ca.pem but no certificate of a role"
            return Check(name, OK, text), False
        certificate = _pair(folder, role)
    except UserError as error:
        return Check(name, FAILED, str(error)), False
    wrong = _wrong(folder, role, certificate, authority, now)
    if wrong is not None:
        return Check(name, FAILED, wrong), True
    return Check(name, OK, _right(folder, role, certificate, authority, now)), True


def _authority(folder: Path, now: datetime) -> x509.Certificate:
    if not folder.is_dir():
        raise UserError(f"{folder} is no folder; make it with `lndrl certs --out {folder}`")
    if not (folder / "ca.pem").exists():
        raise UserError(
            f"{folder}/ca.pem is missing; copy it from where `lndrl certs` made the certificates"
        )
    authority = load_certificate(folder / "ca.pem")
    if now >= authority.not_valid_after_utc:
        raise UserError(
            f"{folder}/ca.pem expired on {authority.not_valid_after_utc:%Y-%m-%d}; make a new"
            " authority with `lndrl certs` in an empty folder, for all machines"
        )
    if now < authority.not_valid_before_utc:
        raise UserError(f"{folder}/ca.pem is not yet valid; {_clock(now)}")
    return authority


def _pair(folder: Path, role: str) -> x509.Certificate:
    """The role's certificate; raises UserError where it cannot be used with its key."""
    for kind in ("pem", "key"):
        if not (folder / f"{role}.{kind}").exists():
            raise UserError(
                f"{folder}/{role}.{kind} is missing; copy it from where `lndrl certs` made it"
            )
    certificate = load_certificate(folder / f"{role}.pem")
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.load_cert_chain(folder / f"{role}.pem", folder / f"{role}.key", password="")
    except ssl.SSLError as error:
        if "MISMATCH" in (error.reason or ""):
            raise UserError(
                f"{folder}/{role}.key does not fit {role}.pem; copy both from one place"
            ) from None
        raise UserError(
            f"{folder}/{role}.key is not a private key in PEM format without password"
        ) from None
    except OSError as error:
        raise UserError(f"{folder}/{role}.key: cannot be read ({error.strerror})") from None
    return certificate


def _wrong(
    folder: Path, role: str, certificate: x509.Certificate, authority: x509.Certificate,
    now: datetime,
) -> str | None:  # fmt: skip
    file = f"{folder}/{role}.pem"
    renewal = f"make a new one with `lndrl certs --out FOLDER --renew {role}`"
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        return f"{file} is of another authority than ca.pem beside it; copy both from one place"
    found = _name(certificate)
    if found != common_name(role):
        return (
            f"{file} names {found}, not {common_name(role)}; access control goes by this name:"
            f" copy the right file, or {renewal}"
        )
    if now >= certificate.not_valid_after_utc:
        return f"{file} expired on {certificate.not_valid_after_utc:%Y-%m-%d}; {renewal}"
    if now < certificate.not_valid_before_utc:
        return f"{file} is not yet valid; {_clock(now)}"
    return None


def _right(
    folder: Path, role: str, certificate: x509.Certificate, authority: x509.Certificate,
    now: datetime,
) -> str:  # fmt: skip
    left = certificate.not_valid_after_utc - now
    text = f"{common_name(role)}, valid for {counted(left.days, 'more day')}"
    if left < SOON and certificate.not_valid_after_utc < authority.not_valid_after_utc:
        text += f": make a new one soon with `lndrl certs --out FOLDER --renew {role}`"
    elif left < SOON:
        text += ": the authority ends then, too; make new certificates for all in an empty folder"
    mode = (folder / f"{role}.key").stat().st_mode & 0o777
    if mode & 0o077:
        text += f"; others can read {role}.key (mode {mode:o}): chmod 600 {folder}/{role}.key"
    return text


def _clock(now: datetime) -> str:
    return f"this machine's clock says {now:%Y-%m-%d %H:%M} UTC: set it right"
