"""Certificates as TLS sees them: two sides of Python's ssl, and of zenoh, believe each other."""

from __future__ import annotations

import ssl
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from hypothesis import given
from hypothesis import strategies as st

from lndrl.errors import UserError
from lndrl.transport.security import certificates, identity
from lndrl.transport.security.certificates import (
    ROLES,
    create,
    host_names,
    learner_hosts,
    load_certificate,
    renew,
)
from lndrl.transport.zenoh.session import free_endpoint, open_session

NOW = datetime.now(UTC)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("made") / "certs"
    create(made, ["Robot.lab", "10.1.2.3", "fd00::5"], days=90)
    return made


def handshake(client: ssl.SSLContext, server: ssl.SSLContext, name: str) -> None:
    """Both sides of a TLS session in memory; raises what one of them raises."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = [
        client.wrap_bio(to_client, to_server, server_hostname=name),
        server.wrap_bio(to_server, to_client, server_side=True),
    ]
    for _ in range(4):
        for end in ends:
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
    for end in ends:
        try:
            end.read(1)
        except ssl.SSLWantReadError:
            continue


def side(folder: Path, role: str, purpose: ssl.Purpose) -> ssl.SSLContext:
    context = ssl.create_default_context(purpose, cafile=str(folder / "ca.pem"))
    context.load_cert_chain(folder / f"{role}.pem", folder / f"{role}.key")
    context.verify_mode = ssl.CERT_REQUIRED
    # The strictest reading of RFC 5280 that OpenSSL knows; default from Python 3.13 on.
    context.verify_flags |= ssl.VERIFY_X509_STRICT
    return context


def test_the_files_are_there_and_the_keys_are_private(folder: Path) -> None:
    names = {f"{name}.{kind}" for name in ("ca", *ROLES) for kind in ("pem", "key")}
    assert {file.name for file in folder.iterdir()} == names
    for file in folder.iterdir():
        assert stat.S_IMODE(file.stat().st_mode) == (0o600 if file.suffix == ".key" else 0o644)


@pytest.mark.parametrize("role", ["actor", "dashboard"])
@pytest.mark.parametrize("name", ["robot.lab", "10.1.2.3", "fd00::5", "localhost", "127.0.0.1"])
def test_both_sides_believe_each_other(folder: Path, role: str, name: str) -> None:
    client = side(folder, role, ssl.Purpose.SERVER_AUTH)
    handshake(client, side(folder, "learner", ssl.Purpose.CLIENT_AUTH), name)


def test_another_name_is_not_believed(folder: Path) -> None:
    client = side(folder, "actor", ssl.Purpose.SERVER_AUTH)
    with pytest.raises(ssl.SSLCertVerificationError, match=r"not valid for 'other.lab'"):
        handshake(client, side(folder, "learner", ssl.Purpose.CLIENT_AUTH), "other.lab")


@pytest.mark.parametrize("role", ["actor", "dashboard"])
def test_no_role_but_the_learner_can_serve(folder: Path, role: str) -> None:
    client = side(folder, "actor", ssl.Purpose.SERVER_AUTH)
    client.check_hostname = False
    with pytest.raises(ssl.SSLCertVerificationError, match="purpose"):
        handshake(client, side(folder, role, ssl.Purpose.CLIENT_AUTH), "localhost")


def test_the_certificates_say_what_they_are(folder: Path) -> None:
    authority = load_certificate(folder / "ca.pem")
    assert authority.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    for role in ROLES:
        certificate = load_certificate(folder / f"{role}.pem")
        certificate.verify_directly_issued_by(authority)
        assert certificate.subject.rfc4514_string() == f"CN=lndrl-{role}"
        assert not certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
        # A clock that is hours behind must not refuse a new certificate.
        assert certificate.not_valid_before_utc < NOW - timedelta(hours=23)
        left = certificate.not_valid_after_utc - NOW
        assert timedelta(days=89) < left < timedelta(days=91)
    assert set(host_names(load_certificate(folder / "learner.pem"))) == {
        "robot.lab", "10.1.2.3", "fd00::5", "localhost", "127.0.0.1", "::1"
    }  # fmt: skip
    assert host_names(load_certificate(folder / "actor.pem")) == []


def test_nothing_is_overwritten(folder: Path, tmp_path: Path) -> None:
    before = {file: file.read_bytes() for file in folder.iterdir()}
    with pytest.raises(UserError, match=r"already holds ca.pem, .* never overwritten"):
        create(folder, [])
    assert {file: file.read_bytes() for file in folder.iterdir()} == before
    (tmp_path / "dashboard.key").write_text("mine")
    with pytest.raises(UserError, match=r"already holds dashboard.key, "):
        create(tmp_path, [])
    assert [file.name for file in tmp_path.iterdir()] == ["dashboard.key"]


def test_what_cannot_be_finished_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = certificates._write

    def fail_late(file: Path, data: bytes) -> None:
        if file.name == "actor.pem":
            raise OSError(28, "No space left on device")
        write(file, data)

    monkeypatch.setattr(certificates, "_write", fail_late)
    with pytest.raises(UserError, match=r"cannot be written .No space left"):
        create(tmp_path, [])
    assert list(tmp_path.iterdir()) == []


def test_renewing_keeps_authority_names_and_the_other_roles(tmp_path: Path) -> None:
    create(tmp_path, ["robot.lab"], days=10)
    old = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    ends = renew(tmp_path, ["learner", "learner"], days=50)
    new = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    changed = {name for name in new if new[name] != old.get(name)}
    assert changed == {"learner.pem", "learner.key"} and len(new) == len(old)
    assert stat.S_IMODE((tmp_path / "learner.key").stat().st_mode) == 0o600
    assert ends["learner"] > NOW + timedelta(days=49)
    assert "robot.lab" in host_names(load_certificate(tmp_path / "learner.pem"))
    client = side(tmp_path, "actor", ssl.Purpose.SERVER_AUTH)
    handshake(client, side(tmp_path, "learner", ssl.Purpose.CLIENT_AUTH), "robot.lab")
    renew(tmp_path, ["learner"], ["new.lab"])
    assert "robot.lab" not in host_names(load_certificate(tmp_path / "learner.pem"))


def test_no_certificate_outlives_its_authority(tmp_path: Path) -> None:
    create(tmp_path, [], now=NOW - timedelta(days=3600))
    end = load_certificate(tmp_path / "ca.pem").not_valid_after_utc
    assert renew(tmp_path, ["actor"], days=365)["actor"] == end


def test_renewing_needs_a_valid_authority(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"holds no ca.pem; renew in the folder"):
        renew(tmp_path, ["actor"])
    create(tmp_path, [], now=NOW - timedelta(days=3651))
    with pytest.raises(UserError, match=r"ca.pem has expired"):
        renew(tmp_path, ["actor"])
    (tmp_path / "ca.key").write_bytes((tmp_path / "actor.key").read_bytes())
    with pytest.raises(UserError, match=r"ca.key does not belong to ca.pem"):
        renew(tmp_path, ["actor"])
    (tmp_path / "ca.key").write_text("nonsense")
    with pytest.raises(UserError, match=r"ca.key: is not a private key"):
        renew(tmp_path, ["actor"])
    (tmp_path / "ca.key").unlink()
    with pytest.raises(UserError, match=r"holds no ca.key"):
        renew(tmp_path, ["actor"])
    with pytest.raises(UserError, match=r"role 'robot' is unknown"):
        renew(tmp_path, ["robot"])


@pytest.mark.parametrize(
    "host",
    ["", "tcp/robot:7447", "robot:7447", "a b", "*.lab", "-a.lab", "a..b", "1.2.3", "256.1.1.1",
     "fe80::1%eth0", "x" * 64, "größe.lab"],
)  # fmt: skip
def test_what_is_no_host_is_a_sentence(host: str) -> None:
    with pytest.raises(UserError, match="neither a host name nor an address"):
        learner_hosts([host])


@given(st.text(max_size=80))
def test_any_text_is_a_host_that_a_certificate_can_hold_or_a_sentence(text: str) -> None:
    try:
        names = learner_hosts([text])
    except UserError:
        return
    for name in names:
        certificates._general_name(name)


def test_zenoh_believes_them(folder: Path) -> None:
    """The one that matters: rustls takes key type, extensions and names."""
    port = free_endpoint().rpartition(":")[2]
    quiet = {"scouting/multicast/enabled": False, "scouting/gossip/enabled": False}
    tls = "transport/link/tls"
    listening = open_session(
        {
            **quiet,
            "mode": "router",
            "listen/endpoints": [f"tls/127.0.0.1:{port}"],
            f"{tls}/root_ca_certificate": str(folder / "ca.pem"),
            f"{tls}/listen_certificate": str(folder / "learner.pem"),
            f"{tls}/listen_private_key": str(folder / "learner.key"),
            f"{tls}/enable_mtls": True,
        },
        20,
    )
    try:
        for role in ROLES:
            protected = identity.settings(identity.Security(role, folder))
            for host in ("127.0.0.1", "localhost"):
                wanted = {"mode": "client", "connect/endpoints": [f"tls/{host}:{port}"]}
                session = open_session({**quiet, **wanted, **protected}, 20)
                links = [str(link.dst) for link in session.info.links()]
                assert len(links) == 1 and links[0].startswith("tls/")
                session.close()
    finally:
        listening.close()


def test_secrets_stay_out_of_the_repr() -> None:
    assert "hidden" not in repr(identity.Security("actor", user="actor", password="hidden"))
