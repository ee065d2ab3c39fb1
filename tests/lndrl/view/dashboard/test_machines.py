from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rich.cells import cell_len

from lndrl.machine.load import Load
from lndrl.transport.status import parse_reply, parse_status
from lndrl.view.dashboard.machines import hosts_of, line, machines
from lndrl.view.dashboard.view import View
from lndrl.view.dashboard.zoom import zoomed

ACTORS = [
    {"id": "a", "host": "one", "rate": 5.0, "machine": {"cpu": 0.2, "memory": 0.5, "cores": 8}},
    {"id": "b", "host": "two", "rate": 1.0, "machine": {"cpu": 0.9, "memory": 0.1, "cores": 8}},
    {"id": "c", "host": "two", "rate": 2.0, "machine": {}},
    {"id": "d", "host": "three", "state": "gone", "machine": {"cpu": 1.0, "cores": 1}},
    {"id": "e", "host": "four"},
]
HEAD = {"cpu": 0.4, "memory": 0.3, "cores": 4, "gigabytes": 16}


def test_machines_stand_by_how_busy_they_are() -> None:
    snapshot = {"time": 1.0, "steps": 1, "total_steps": 2, "actors": ACTORS}
    status = parse_status({**snapshot, "host": "head", "machine": HEAD})
    found = [(host.name, host.work, host.rate) for host in hosts_of(status)]
    assert found == [
        ("head", "learner", 0.0),
        ("two", "2 actors", 3.0),
        ("one", "1 actor", 5.0),
        ("four", "1 actor", 0.0),
    ]
    for width in (60, 76, 116):
        panel = machines(status, width, 4)
        assert {cell_len(each.plain) for each in panel.lines} == {width}
        assert len(panel.lines) == 4 and "+2 more" in panel.lines[-1].plain
        assert panel.lines[0].plain.rstrip().endswith("steps/s") or width < 65
    assert "90 %" in machines(status, 80, 9).lines[2].plain
    assert "3  CPU up to 90 % (two)  memory up to 50 % (one)" in line(status, 80).plain
    assert "nothing is known" in line(parse_status(snapshot | {"actors": []}), 80).plain


def test_gpus_have_a_column_where_there_are_any() -> None:
    card = {"gpus": 2, "gpu": 0.37, "gpu_memory": 0.81}
    head = {"time": 1.0, "steps": 1, "total_steps": 2, "actors": ACTORS, "host": "head"}
    head["machine"] = HEAD
    with_one = parse_status({**head, "machine": {**HEAD, **card}})
    assert "GPU" not in machines(parse_status(head), 116, 9).lines[0].plain
    for width in (76, 81, 116):
        panel = machines(with_one, width, 9)
        assert {cell_len(each.plain) for each in panel.lines} == {width}
        assert panel.lines[0].plain.rstrip().endswith("steps/s"), "no column is cut off"
        assert "GPU" in panel.lines[0].plain and "37 %" in panel.lines[1].plain
        assert ("81 %" in panel.lines[1].plain) is (width >= 81)
        assert "37 %" not in panel.lines[2].plain
    assert "GPU up to 37 % (head)" in line(with_one, 100).plain


def test_the_machine_here_is_measured() -> None:
    load = Load(every=0.0)
    sum(i * i for i in range(200_000))
    found = load.now()
    assert 0 <= found["cpu"] <= 1 and 0 < found["memory"] < 1 and found["cores"] >= 1
    assert found["gigabytes"] > 0.1
    assert Load(every=60.0).now() == {}


def test_lags_are_a_histogram(answer: Callable[..., dict[str, Any]]) -> None:
    lag = {"mean": 0.5, "max": 40, "shares": [0.5, 0.25, *[0.0] * 13, 0.25]}
    status, history = parse_reply(answer(lag=lag))
    text = "\n".join(each.plain for each in zoomed(status, history, View("ppo"), 120, 60).lines)
    assert "lag of the last batch" in text and "15+ " in text and "50.0 %" in text
