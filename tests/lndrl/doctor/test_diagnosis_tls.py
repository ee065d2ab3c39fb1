"""Every way in which certificates and TLS can fail, provoked on loopback, and its sentence."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from lndrl.transport import (
    free_endpoint,
)
from lndrl.transport.security import certificates
from lndrl.transport.security.certificates import create, renew
from tests.lndrl.doctor.examined import examine, failed, learner, mutual

NOW = datetime.now(UTC)


@pytest.mark.parametrize("with_files", [True, False])
def test_plain_against_tls_is_told(folder: Path, standing: str, with_files: bool) -> None:
    wrong = standing.replace("tls/", "tcp/")
    checks = examine(wrong, role="actor", certificates=folder if with_files else None)
    assert failed(checks) == ["actor: session"]
    text = checks["actor: session"].text
    assert text.startswith("the learner speaks TLS and was spoken to without") and standing in text


def test_tls_against_plain_is_told(folder: Path) -> None:
    with learner() as endpoint:
        wrong = endpoint.replace("tcp/", "tls/")
        checks = examine(wrong, role="actor", certificates=folder, timeout=1.5)
    assert failed(checks) == ["actor: tls"] and checks["actor: session"].state == "skipped"
    assert "does not speak TLS" in checks["actor: tls"].text
    assert f"write {endpoint}," in checks["actor: tls"].text


def test_no_folder_and_no_certificate_are_told(folder: Path, standing: str, ours: Path) -> None:
    for file in ours.iterdir():
        if file.name != "ca.pem":
            file.unlink()
    nothing = examine(standing)
    only_ca = examine(standing, certificates=ours)
    no_pair = examine(standing, certificates=ours, role="actor")
    assert failed(nothing) == ["tls"] and "give --certs FOLDER" in nothing["tls"].text
    assert failed(only_ca) == ["tls"]
    assert only_ca["tls"].text.startswith("the learner wants a certificate and none")
    assert failed(no_pair) == ["actor: certificates", "actor: tls"]
    assert "actor.pem is missing; copy it" in no_pair["actor: certificates"].text


def test_the_learner_of_another_authority_is_told(folder: Path, others: Path) -> None:
    with learner("tls", mutual(others)) as endpoint:
        checks = examine(endpoint, certificates=folder, role="actor")
    assert failed(checks) == ["actor: tls"]
    assert f"of another authority than {folder}/ca.pem" in checks["actor: tls"].text


def test_ours_of_another_authority_is_told(
    folder: Path, standing: str, others: Path, ours: Path
) -> None:
    for name in ("actor.pem", "actor.key"):
        (ours / name).write_bytes((others / name).read_bytes())
    checks = examine(standing, certificates=ours, role="actor")
    assert failed(checks) == ["actor: certificates", "actor: tls"]
    assert "of another authority than ca.pem beside it" in checks["actor: certificates"].text
    assert "refuses" in checks["actor: tls"].text
    assert "another authority than the learner's" in checks["actor: tls"].text


def test_the_learners_expired_certificate_is_told(folder: Path, ours: Path) -> None:
    renew(ours, ["learner"], days=1, now=NOW - timedelta(days=5))
    with learner("tls", mutual(ours)) as endpoint:
        checks = examine(endpoint, certificates=folder, role="actor")
    assert failed(checks) == ["actor: tls"]
    assert checks["actor: tls"].text.startswith("the learner's certificate has expired")


def test_the_learners_future_certificate_is_told(folder: Path, ours: Path) -> None:
    renew(ours, ["learner"], now=NOW + timedelta(days=5))
    with learner("tls", mutual(ours)) as endpoint:
        checks = examine(endpoint, certificates=folder, role="actor")
    assert failed(checks) == ["actor: tls"]
    assert "not yet valid; set the clocks right" in checks["actor: tls"].text


def test_our_expired_certificate_is_told(folder: Path, standing: str, ours: Path) -> None:
    renew(ours, ["actor"], days=1, now=NOW - timedelta(days=5))
    checks = examine(standing, certificates=ours, role="actor")
    assert failed(checks) == ["actor: certificates", "actor: tls"]
    assert "actor.pem expired on" in checks["actor: certificates"].text
    assert "`lndrl certs --out FOLDER --renew actor`" in checks["actor: certificates"].text
    assert "expired by the learner's clock" in checks["actor: tls"].text


def test_another_name_is_told_with_the_right_ones(folder: Path, ours: Path) -> None:
    hosts = certificates.LOCAL_HOSTS
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(certificates, "LOCAL_HOSTS", ())
        renew(ours, ["learner"], ["robot.lab", "10.1.2.3"])
    assert hosts == certificates.LOCAL_HOSTS
    with learner("tls", mutual(ours)) as endpoint:
        checks = examine(endpoint, certificates=folder, role="actor")
    assert failed(checks) == ["actor: tls"]
    assert "not made for 127.0.0.1 but for robot.lab, 10.1.2.3;" in checks["actor: tls"].text


@pytest.mark.parametrize("role", ["actor", "learner"])
def test_a_certificate_under_another_files_name_is_told(
    role: str, folder: Path, standing: str, ours: Path, brief: None
) -> None:
    for kind in ("pem", "key"):
        (ours / f"{role}.{kind}").write_bytes((ours / f"dashboard.{kind}").read_bytes())
    checks = examine(standing, certificates=ours, role=role)
    assert f"{role}: certificates" in failed(checks)
    assert checks[f"{role}: tls"].text.endswith(f"takes {role}.pem")
    assert checks[f"{role}: session"].text.endswith("lets in certificate lndrl-dashboard")


def test_an_actor_that_poses_as_the_learner_is_told(folder: Path) -> None:
    posing = {"listen_certificate": "actor.pem", "listen_private_key": "actor.key"}
    changed = {name: str(folder / file) for name, file in posing.items()}
    with learner("tls", mutual(folder, **changed)) as endpoint:
        checks = examine(endpoint, certificates=folder, role="dashboard")
    assert failed(checks) == ["dashboard: tls"]
    assert "a certificate that is no learner's" in checks["dashboard: tls"].text


def test_a_key_that_does_not_fit_is_told(folder: Path, standing: str, ours: Path) -> None:
    (ours / "actor.key").write_bytes((ours / "learner.key").read_bytes())
    checks = examine(standing, certificates=ours, role="actor")
    assert failed(checks) == ["actor: certificates", "actor: tls"]
    assert "actor.key does not fit actor.pem" in checks["actor: certificates"].text


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda f: (f / "ca.pem").unlink(), "ca.pem is missing; copy it"),
        (lambda f: (f / "ca.pem").write_text("?"), "ca.pem: is not a certificate in PEM"),
        (lambda f: (f / "actor.key").unlink(), "actor.key is missing; copy it"),
        (lambda f: (f / "actor.key").write_text("?"), "actor.key is not a private key"),
        (lambda f: (f / "actor.pem").write_text("?"), "actor.pem: is not a certificate"),
        (
            lambda f: [
                (f / f"actor.{kind}").write_bytes((f / f"dashboard.{kind}").read_bytes())
                for kind in ("pem", "key")
            ],
            "actor.pem names lndrl-dashboard, not lndrl-actor",
        ),
        (lambda f: renew(f, ["actor"], now=NOW + timedelta(days=3)), "actor.pem is not yet valid"),
    ],
)
def test_spoiled_files_are_told(spoil: Callable[[Path], Any], sentence: str, ours: Path) -> None:
    spoil(ours)
    checks = examine(free_endpoint(), certificates=ours, role="actor")
    assert checks["actor: certificates"].state == "failed"
    assert sentence in checks["actor: certificates"].text


def test_what_ends_soon_or_is_readable_is_said(ours: Path, tmp_path: Path) -> None:
    (ours / "actor.key").chmod(0o644)
    renew(ours, ["dashboard"], days=12)
    checks = examine(free_endpoint(), certificates=ours)
    actor, dashboard = checks["actor: certificates"], checks["dashboard: certificates"]
    assert actor.state == dashboard.state == "ok"
    assert "others can read actor.key (mode 644)" in actor.text
    assert "valid for 11 more days: make a new one soon" in dashboard.text
    missing = examine(free_endpoint(), certificates=tmp_path / "nowhere")["certificates"]
    assert "nowhere is no folder; make it with `lndrl certs" in missing.text
    create(tmp_path / "old", [], now=NOW - timedelta(days=3660))
    old = examine(free_endpoint(), certificates=tmp_path / "old", role="actor")
    assert "old/ca.pem expired on" in old["actor: certificates"].text
