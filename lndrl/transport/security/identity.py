"""Who a session is and whom it lets in: certificates, users, and the zenoh settings for them.

Nothing here prints a secret: sentences name files, lines and users, never what a line holds.
"""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from lndrl.errors import UserError
from lndrl.transport.security.access import ROLES, access_control, role_of, subjects

ENDPOINT = re.compile(r"(tcp|tls)/(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9_.\-]+):(\d{1,5})\Z")
_USER = re.compile(r"[a-z]+(-[A-Za-z0-9_.\-]+)?")
_TLS = "transport/link/tls"


@dataclass(frozen=True)
class Security:
    """What protects a session. Paths are used as they are; ``check`` says what is wrong."""

    role: str
    """One of ``access.ROLES``."""
    certificates: Path | None = None
    """Folder holding ca.pem, ROLE.pem and ROLE.key."""
    user: str | None = None
    """User name, connecting side; its role is the part before the first ``-``."""
    password: str | None = field(default=None, repr=False)
    """From a file or the environment, never from a command line."""
    users: Path | None = None
    """Listening side: file of ``user:password`` lines."""
    overlay: Path | None = None
    """JSON5 file of zenoh settings, applied last."""
    insecure: bool = False
    """Listen beyond loopback although nothing protects it."""

    def check(self, endpoint: str, listening: bool) -> None:
        """Raises UserError for files, names and endpoints that cannot work together."""
        if self.role not in ROLES:
            raise ValueError(f"{self.role} is none of {', '.join(ROLES)}")
        scheme = parse_endpoint(endpoint)[0]
        if self.certificates is not None:
            if scheme != "tls":
                raise UserError(
                    f"endpoint {endpoint} does not use the certificates in {self.certificates};"
                    f" write tls/{endpoint.partition('/')[2]}"
                )
            check_certificates(self.certificates, self.role)
        elif scheme == "tls" and self.overlay is None:
            raise UserError(f"endpoint {endpoint} needs certificates; name their folder: --certs")
        if listening and self.users is not None:
            read_users(self.users)
        if not listening:
            self._check_login()

    def _check_login(self) -> None:
        if self.users is not None:
            raise UserError(
                f"{self.users}: a users file belongs to the side that listens; the connecting"
                " side takes --user and --password-file"
            )
        if self.user is None:
            if self.password is not None:
                raise UserError("there is a password but no user; add --user NAME")
            return
        if self.password is None:
            raise UserError(
                f"user {self.user} has no password; put it in a file for --password-file or in"
                " the environment variable LNDRL_PASSWORD"
            )
        if not _USER.fullmatch(self.user) or role_of(self.user) != self.role:
            raise UserError(
                f"user {self.user!r} cannot be used by this command; its users are called"
                f" {self.role} or {self.role}-NAME"
            )

    def of_local(self, role: str) -> Security | None:
        """What processes of ``role`` need that the learner's own program starts; None for nothing.

        Raises UserError when the folder has no certificate for them or the users file no user.
        """
        if self.certificates is None and self.users is None:
            return None
        found = Security(role, self.certificates)
        if self.certificates is not None:
            check_certificates(self.certificates, role)
        if self.users is None:
            return found
        for user, password in read_users(self.users).items():
            if role_of(user) == role:
                return replace(found, user=user, password=password)
        raise UserError(f"{self.users}: has no user called {role} or {role}-NAME, needed here")


def settings(security: Security, listening: bool = False, namespace: str = "") -> dict[str, Any]:
    """The zenoh settings, path to value, without the overlay; ``check`` comes before.

    Unchecked, a connecting side without its own certificate shows none.
    """
    found: dict[str, Any] = {}
    if security.certificates is not None:
        found.update(_tls(security.certificates, security.role, listening))
    if not listening:
        if security.user is not None:
            found["transport/auth/usrpwd/user"] = security.user
            found["transport/auth/usrpwd/password"] = security.password
        return found
    names = None
    if security.users is not None:
        names = list(read_users(security.users))
        found["transport/auth/usrpwd/dictionary_file"] = str(security.users.absolute())
    roles = subjects(security.certificates is not None, names)
    if roles:
        found["access_control"] = access_control(roles, (namespace,))
    return found


def parse_endpoint(endpoint: str) -> tuple[str, str, int]:
    """Scheme, host and port of ``tcp/HOST:PORT`` or ``tls/HOST:PORT``; raises UserError."""
    match = ENDPOINT.match(endpoint)
    if match is None or not 0 < int(match[3]) < 65536:
        raise UserError(
            f"endpoint {endpoint!r} must look like tcp/HOST:PORT or tls/HOST:PORT with a port"
            " from 1 to 65535, e.g. tcp/127.0.0.1:7447; whatever else zenoh knows goes into a file"
            " for --zenoh"
        )
    return match[1], match[2], int(match[3])


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches ``host``; names other than localhost count as others."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def check_certificates(folder: Path, role: str) -> None:
    """Raises UserError unless ``folder`` holds ca.pem, ROLE.pem and a private ROLE.key."""
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder of certificates; lndrl certs --out makes one")
    for name in ("ca.pem", f"{role}.pem", f"{role}.key"):
        path = folder / name
        _read(path)
        if path.suffix == ".key":
            check_private(path)


def check_private(path: Path) -> None:
    """Raises UserError where others than its owner may read ``path``."""
    if path.stat().st_mode & 0o077:
        raise UserError(f"{path}: others on this machine may read it; chmod 600 {path}")


def read_users(path: Path) -> dict[str, str]:
    """User to password of a file of ``user:password`` lines; raises UserError.

    The same lines that zenoh accepts, less what it would take in silence: an empty file lets
    everybody in, of two lines for one user the last counts.
    """
    lines = _read(path).split("\n")
    check_private(path)
    found: dict[str, str] = {}
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        user, colon, password = (part.strip() for part in line.partition(":"))
        where = f"{path}, line {number}"
        if not colon or not password or not password.isprintable():
            raise UserError(f"{where}: must be user:password, with nothing missing or unprintable")
        if not _USER.fullmatch(user) or role_of(user) not in ROLES:
            raise UserError(
                f"{where}: the user's name must be {', '.join(ROLES)}, or one of them with -NAME"
                " behind it; the name gives the role"
            )
        if user in found:
            raise UserError(f"{where}: user {user} has a line above already; keep one")
        found[user] = password
    if not found:
        raise UserError(f"{path}: names no user; write lines of user:password")
    return found


def read_password(path: Path) -> str:
    """The one line of a password file; raises UserError."""
    lines = [line.strip() for line in _read(path).split("\n")]
    check_private(path)
    filled = [line for line in lines if line]
    if len(filled) != 1:
        raise UserError(f"{path}: must hold the password on one line and nothing else")
    return filled[0]


def _read(path: Path) -> str:
    try:
        return path.read_text("utf-8")
    except FileNotFoundError:
        raise UserError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise UserError(f"{path}: is not text in UTF-8") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror})") from None


def _tls(folder: Path, role: str, listening: bool) -> dict[str, Any]:
    folder = folder.absolute()
    own = {"certificate": folder / f"{role}.pem", "private_key": folder / f"{role}.key"}
    found: dict[str, Any] = {
        f"{_TLS}/root_ca_certificate": str(folder / "ca.pem"),
        f"{_TLS}/verify_name_on_connect": True,
        f"{_TLS}/close_link_on_expiration": True,
        "transport/link/protocols": ["tls"],
    }
    if listening or own["certificate"].exists():
        found[f"{_TLS}/enable_mtls"] = True
        for side in ("listen", "connect") if listening else ("connect",):
            found |= {f"{_TLS}/{side}_{what}": str(path) for what, path in own.items()}
    return found
