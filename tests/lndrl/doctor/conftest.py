"""Certificates, ours and another authority's, and a learner that wants ours."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from lndrl.doctor import diagnosis, permissions, probes
from lndrl.transport.security.certificates import create
from tests.lndrl.doctor.examined import PATIENCE, learner, mutual


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("ours")
    create(made, [], days=90)
    return made


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("others")
    create(made, [])
    return made


@pytest.fixture
def ours(folder: Path, tmp_path: Path) -> Path:
    """A copy of ``folder`` that a test may spoil."""
    mine = tmp_path / "mine"
    mine.mkdir()
    for file in folder.iterdir():
        (mine / file.name).write_bytes(file.read_bytes())
        (mine / file.name).chmod(0o600)
    return mine


@pytest.fixture(scope="module")
def standing(folder: Path) -> Iterator[str]:
    """The endpoint of a learner that wants a certificate of ``folder``."""
    with learner("tls", mutual(folder)) as endpoint:
        yield endpoint


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Long waits for what comes: the machine may have much else to do."""
    for room, name in (
        (permissions, "ANSWER_SECONDS"),
        (permissions, "UPLOAD_SECONDS"),
        (permissions, "HEARING_SECONDS"),
        (diagnosis, "ANSWER_SECONDS"),
        (diagnosis, "TLS_SECONDS"),
        (probes, "REFUSAL_SECONDS"),
    ):
        monkeypatch.setattr(room, name, PATIENCE)


@pytest.fixture
def brief(patient: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Short waits for what does not come; what is published comes ten times a second."""
    monkeypatch.setattr(permissions, "HEARING_SECONDS", 3.0)
    monkeypatch.setattr(diagnosis, "TLS_SECONDS", 0.3)
    monkeypatch.setattr(probes, "REFUSAL_SECONDS", 0.1)
