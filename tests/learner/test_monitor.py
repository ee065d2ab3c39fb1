"""The learner's own endpoint for Prometheus, beside a learner that learns."""

from __future__ import annotations

import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from learner.monitor import Monitor
from learner.status import StatusThread
from lndrl.machine.ports import free_port
from lndrl.transport.status import Status, parse_status
from lndrl.view.monitoring.families import families
from tests.learner.helpers_learner import small_config
from tests.learner.test_learner import Run


def values(url: str) -> dict[str, float]:
    """What is served, by name and labels."""
    with urllib.request.urlopen(url, timeout=20.0) as answer:
        lines = answer.read().decode().splitlines()
    pairs = [line.rpartition(" ") for line in lines if not line.startswith("#")]
    return {name: float(value) for name, _, value in pairs}


@pytest.fixture
def monitor() -> Iterator[Monitor]:
    made = Monitor("127.0.0.1", free_port())
    yield made
    made.close()


def test_what_a_learner_does_is_counted_and_a_resume_counts_anew(
    monitor: Monitor, tmp_path: Path
) -> None:
    run = Run(small_config(), tmp_path / "run")
    status = StatusThread(run.learner)
    monitor.follow(status)
    assert values(monitor.url)["lndrl_up"] == 0.0, "before it has said anything"
    run.update(2)
    run.send(version=1)
    status._publish()
    found = values(monitor.url)
    assert found["lndrl_up"] == 1.0
    assert found["lndrl_steps_total"] == found["lndrl_run_steps"] == 64
    assert found["lndrl_updates_total"] == found["lndrl_run_updates"] == 2
    assert found['lndrl_uploads_total{answer="accepted"}'] == 5
    assert found["lndrl_upload_seconds_count"] == 5 and found["lndrl_upload_seconds_sum"] > 0
    assert found["lndrl_upload_bytes_total"] > 5 * 16 * 720 * 2, "the scans alone are as many"
    assert found["lndrl_queue_chunks"] == 1 and found["lndrl_queue_bytes"] > 0
    assert found["lndrl_sample_lag_versions_count"] == 64
    assert found['lndrl_actors{state="active"}'] == 1
    assert found['lndrl_run_samples{fate="trained"}'] == 64
    assert found["lndrl_kl_nats"] == pytest.approx(run.learner.figures["kl"])
    assert found["lndrl_checkpoint_timestamp_seconds"] <= found["lndrl_status_timestamp_seconds"]
    assert found["process_resident_memory_bytes"] > 1e7
    before = found["lndrl_weights_sent_bytes_total"]
    blob = run.actor.fetch()[1]
    run.close()

    status._publish()
    assert values(monitor.url)["lndrl_weights_sent_bytes_total"] == before + len(blob)

    again = Run(small_config(), tmp_path / "run", resume=True)
    again.update()
    later = parse_status(_snapshot(again))
    again.close()
    found = {sample.name: sample.value for each in families(later) for sample in each.samples}
    assert found["lndrl_run_steps"] == 96 and found["lndrl_steps_total"] == 32


def test_a_status_is_read_once_however_many_ask(
    monitor: Monitor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(small_config(), tmp_path / "run")
    status = StatusThread(run.learner)
    status._publish()
    read: list[Status] = []

    def noted(data: object) -> Status:
        read.append(parse_status(data))
        return read[-1]

    monkeypatch.setattr("learner.monitor.parse_status", noted)
    monitor.follow(status)
    for _ in range(3):
        values(monitor.url)
    assert len(read) == 1
    run.close()


def _snapshot(run: Run) -> dict[str, object]:
    thread = StatusThread(run.learner)
    thread._publish()
    assert thread.newest is not None
    return thread.newest
