"""Metrics for Prometheus, in the text that it reads."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry, generate_latest

from lndrl.errors import UserError
from lndrl.transport.status import Status, parse_status
from lndrl.view.monitoring import StatusCollector, wanted_ratio
from lndrl.view.monitoring.families import families

ROOT = Path(__file__).resolve().parents[4]
ADDED = ("accounts", "session", "traffic")
SNAPSHOT = {
    "time": 1.0,
    "steps": 2048,
    "total_steps": 9999,
    "updates": 2,
    "weights_version": 2,
    "rate": {"60s": 170.5},
    "time_split": {"wait": 0.5, "update": 0.5},
    "actor_split": {"wait": 0.0, "simulate": 1.0},
    "actors": [{"id": "a"}, {"id": "b", "state": "gone"}],
    "accounts": {"trained": {"chunks": 2, "samples": 2048}, "dropped": {"stale": {"samples": 7}}},
    "session": {
        "started": 5.0,
        "steps": 1024,
        "updates": 1,
        "episodes": {"arrived": 3, "lost": 1},
        "lags": [1000, 20, 4],
        "lag_sum": 28,
    },
    "traffic": {
        "answers": {"accepted": 3, "refused": 1},
        "waits": [1, 2, *[0] * 10, 1],
        "wait_seconds": 31.5,
        "bytes": 4000,
        "weights": 2,
        "weights_bytes": 60,
    },
}


def text_of(look) -> str:
    registry = CollectorRegistry()
    registry.register(StatusCollector(look))
    return generate_latest(registry).decode()


def test_what_a_status_says_is_what_is_scraped() -> None:
    lines = text_of(lambda: parse_status(SNAPSHOT)).splitlines()
    for line in (
        "lndrl_up 1.0",
        "lndrl_run_steps 2048.0",
        "lndrl_steps_total 1024.0",
        'lndrl_episodes_total{outcome="arrived"} 3.0',
        'lndrl_episodes_total{outcome="collided"} 0.0',
        'lndrl_sample_lag_versions_bucket{le="0.0"} 1000.0',
        'lndrl_sample_lag_versions_bucket{le="2.0"} 1024.0',
        'lndrl_sample_lag_versions_bucket{le="+Inf"} 1024.0',
        "lndrl_sample_lag_versions_sum 28.0",
        'lndrl_upload_seconds_bucket{le="0.01"} 3.0',
        'lndrl_upload_seconds_bucket{le="30.0"} 3.0',
        'lndrl_upload_seconds_bucket{le="+Inf"} 4.0',
        'lndrl_uploads_total{answer="refused"} 1.0',
        "lndrl_upload_bytes_total 4000.0",
        "lndrl_steps_per_second 170.5",
        'lndrl_actors{state="active"} 1.0',
        'lndrl_actors{state="gone"} 1.0',
        'lndrl_run_samples{fate="trained"} 2048.0',
        'lndrl_run_samples{fate="stale"} 7.0',
        'lndrl_learner_time_ratio{activity="wait"} 0.5',
        "lndrl_actors_wanted_ratio 2.0",
    ):
        assert line in lines, line
    assert not any(line.startswith("lndrl_lag_versions ") for line in lines)


def test_a_learner_that_is_away_is_down() -> None:
    def look() -> Status:
        raise UserError("no answer")

    assert [line for line in text_of(look).splitlines() if line[0] != "#"] == ["lndrl_up 0.0"]


@pytest.mark.parametrize(
    ("learner", "actors", "wanted"),
    [(0.0, 0.0, 1.0), (0.5, 0.0, 2.0), (0.0, 0.5, 0.5), (1.0, 0.0, 4.0), (0.0, 0.99, 0.25)],
)
def test_how_many_actors_are_wanted(learner: float, actors: float, wanted: float) -> None:
    splits = {"time_split": {"wait": learner}, "actor_split": {"wait": actors}}
    assert wanted_ratio(parse_status(SNAPSHOT | splits)) == pytest.approx(wanted)


def test_before_the_first_update_nothing_is_wanted() -> None:
    assert wanted_ratio(parse_status(SNAPSHOT | {"updates": 0})) == 1.0
    assert wanted_ratio(parse_status(SNAPSHOT | {"actor_split": {}})) == 1.0


def full(answer) -> Status:
    """A status that has a figure for everything."""
    machine = {"cpu": 0.5, "memory": 0.2, "cores": 4}
    told = answer(machine=machine, phase="guided", **{k: SNAPSHOT[k] for k in ADDED})["snapshot"]
    told["ppo"] |= {"teacher_kl": 1.0, "teacher_agreement": 0.5}
    for actor in told["actors"]:
        actor["machine"] = machine
    return parse_status(told)


def test_the_page_has_every_name_with_its_labels_and_its_help(answer) -> None:
    """The table of docs/metrics.md is what this prints where it fails."""
    rows = []
    for family in families(full(answer)):
        ending = {"counter": "_total", "info": "_info"}.get(family.type, "")
        labels = dict.fromkeys(label for sample in family.samples for label in sample.labels)
        words = ", ".join(f"`{label}`" for label in labels if label != "le")
        kind = {"info": "gauge"}.get(family.type, family.type)
        name = family.name + ending
        rows.append(f"| `{name}` | {kind} | {words} | {family.documentation} |")
    page = (ROOT / "docs/metrics.md").read_text()
    assert [line for line in page.splitlines() if line.startswith("| `lndrl_")] == rows, rows


@pytest.mark.skipif(
    shutil.which("promtool") is None, reason="needs promtool (package prometheus), not installed"
)
def test_names_and_helps_are_as_prometheus_wants_them(answer) -> None:
    text = text_of(lambda: full(answer))
    command = ["promtool", "check", "metrics"]
    done = subprocess.run(command, input=text, capture_output=True, text=True)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def test_the_number_of_series_does_not_grow_with_the_fleet(answer) -> None:
    def series(actors: int) -> set[tuple[str, tuple[str, ...]]]:
        rows = answer(fleet=actors)["snapshot"]
        for i, row in enumerate(rows["actors"]):
            row["host"], row["machine"] = f"pod-{i}", {"cpu": 0.5, "memory": 0.1, "cores": 4}
        return {
            (sample.name, tuple(sample.labels.values()))
            for each in families(parse_status(rows))
            for sample in each.samples
        }

    assert series(3) == series(300)
    assert not any(re.search("pod|node|host", word) for _, words in series(9) for word in words)
