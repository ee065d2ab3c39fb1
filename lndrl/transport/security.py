"""What protects a connection: certificates, user and password. Secrets stay out of every repr."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Security:
    """How one side shows who it is and checks who the other is."""

    role: str  # "learner" | "actor" | "dashboard"
    certificates: Path | None = None  # folder of `lndrl certs`: ca.pem, ROLE.pem, ROLE.key
    user: str | None = None  # user and password of the connecting side
    password: str | None = field(default=None, repr=False)
    users: Path | None = None  # listening side: file of `user:password` lines
    overlay: Path | None = None  # JSON5 file of zenoh settings, applied last
    insecure: bool = False  # listen beyond loopback although nothing protects it


def settings(security: Security) -> dict[str, Any]:
    """Zenoh's settings for the connecting side; a role without certificate shows none."""
    found: dict[str, Any] = {}
    folder = security.certificates
    if folder is not None:
        found["transport/link/tls/root_ca_certificate"] = str(folder / "ca.pem")
        found["transport/link/tls/verify_name_on_connect"] = True
        if (folder / f"{security.role}.pem").exists():
            found["transport/link/tls/enable_mtls"] = True
            found["transport/link/tls/connect_certificate"] = str(folder / f"{security.role}.pem")
            found["transport/link/tls/connect_private_key"] = str(folder / f"{security.role}.key")
    if security.user is not None:
        found["transport/auth/usrpwd/user"] = security.user
        found["transport/auth/usrpwd/password"] = security.password or ""
    return found
