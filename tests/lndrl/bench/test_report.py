from __future__ import annotations

import json
import time
from importlib import util
from itertools import cycle

import pytest
from rich.console import Console

from lndrl.bench import report, transport
from lndrl.bench.amcl import measure as measure_amcl
from lndrl.bench.gym import measure as measure_gym
from lndrl.bench.world import measure as measure_world
from lndrl.errors import UserError
from lndrl.transport import ChunkHeader


def test_every_benchmark_has_its_module() -> None:
    for name in report.BENCHMARKS:
        assert util.find_spec(f"lndrl.bench.{name}") is not None


def test_unknown_benchmark_names_the_known_ones() -> None:
    with pytest.raises(UserError, match="'wrld' is unknown; known: laser, crowd"):
        report.measure("wrld", 1.0)


def test_a_device_is_for_those_that_know_devices() -> None:
    with pytest.raises(UserError, match=r"--device: world runs on the CPU; .*learner"):
        report.measure("world", 1.0, "cuda")
    with pytest.raises(UserError, match="device cuda:63: "):
        report.measure("learner", 1.0, "cuda:63")


class Timed:
    """Something to time: each call moves the only clock by the next of these seconds."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *seconds: float) -> None:
        self.now, self.calls = 0.0, 0
        self._seconds = cycle(seconds)
        monkeypatch.setattr(report, "perf_counter", lambda: self.now)

    def __call__(self) -> None:
        self.now += next(self._seconds)
        self.calls += 1


def test_median_is_of_one_call(monkeypatch: pytest.MonkeyPatch) -> None:
    call = Timed(monkeypatch, 0.125)
    assert report.median_seconds(call, 5.0, repetitions=5) == 0.125
    assert call.calls == 1 + 1 + 5 * 8
    call = Timed(monkeypatch, 1.0, 1.0, 5.0, 2.0, 3.0)
    assert report.median_seconds(call, 3.0, repetitions=3) == 3.0


def test_a_slow_call_is_still_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    call = Timed(monkeypatch, 0.001)
    report.median_seconds(call, 1e-6, repetitions=3)
    assert call.calls == 5


def test_a_median_is_measured_by_the_real_clock() -> None:
    assert report.median_seconds(lambda: time.sleep(0.002), 0.05) >= 0.002


def test_machine_says_what_the_figures_depend_on() -> None:
    facts = report.machine()
    assert facts["cpu"] and facts["cores"] >= 1
    assert {"python", "numpy", "numba"} <= set(facts["versions"])
    json.dumps(facts)
    assert f"numpy {facts['versions']['numpy']}" in report.machine_line(facts)


def test_table_shows_nested_figures() -> None:
    console = Console(width=100)
    with console.capture() as captured:
        console.print(report.figures_table("amcl", {"update": {"500x60": 123.456}, "n": 12345}))
    assert "update 500x60" in captured.get()
    assert "123.5" in captured.get() and "12,345" in captured.get()


def test_world_figures() -> None:
    figures = measure_world(0.1)
    assert set(figures["steps_per_second"]) == {"hybrid", "sparse", "corridor", "hall", "irregular"}
    assert min(figures["steps_per_second"].values()) > 0
    assert figures["steps_per_second_perfect_localization"] > 0
    assert 0.05 < figures["megabytes_per_world"] < 8.0
    parts = figures["microseconds_by_part"]
    assert set(parts) == {
        "people",
        "robot_and_contacts",
        "laser",
        "localization",
        "observation_and_reward",
        "episode_starts",
        "python",
    }
    assert min(parts["people"], parts["localization"], parts["episode_starts"]) > 0.0
    best = figures["steps_per_second_best"]
    assert all(best[name] >= rate for name, rate in figures["steps_per_second"].items())


def test_amcl_figures() -> None:
    figures = measure_amcl(0.01)
    for key in ("update_microseconds", "update_microseconds_compiled"):
        assert set(figures[key]) == {"500x60", "2000x60", "2000x100"}
    by_model = figures["update_microseconds_by_model"]
    assert by_model["beam"] > 5 * by_model["likelihood_field"] > 0


def test_transport_rates_leave_out_the_warm_up() -> None:
    warm_up = [(0.1 * i, 10) for i in range(transport._WARM_UP_CHUNKS)]
    began = warm_up[-1][0]
    timed = [(began + 0.01 * (i + 1), 2_000_000) for i in range(50)]
    figures = transport._figures(warm_up + timed, 512)
    assert figures["chunks_per_second"] == pytest.approx(100.0)
    assert figures["megabytes_per_second"] == pytest.approx(200.0)
    assert figures["chunk_kilobytes"] == 2000.0


def test_cpu_of_the_transport_is_that_of_the_timed_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    moments, spent = iter(range(100)), iter([2.0, 3.0, 2.5, 4.5])
    monkeypatch.setattr(transport, "perf_counter", lambda: 0.1 * next(moments))
    monkeypatch.setattr(transport, "cpu_seconds", lambda pid: next(spent))
    receiver = transport._Receiver({}, 1.0)
    receiver.pids = [1, 2]
    for _ in range(transport._WARM_UP_CHUNKS + 14):
        receiver.on_chunk(ChunkHeader("run", "a", "x", 1, 8, 2), {}, 1_000_000)
    assert receiver.full.is_set()
    chunks = receiver.spent[1][1] - receiver.spent[0][1]
    assert chunks in (10, 11), "a second, ten chunks in each"
    assert receiver.cpu_per_megabyte() == pytest.approx(1e3 * (7.0 - 5.0) / chunks)


def test_the_ways_through_gymnasium_are_measured_side_by_side() -> None:
    figures = measure_gym(0.2)
    assert figures.keys() == {
        "steps_per_second_sync",
        "steps_per_second_vector",
        "steps_per_second_raw",
        "vector_of_raw",
        "sync_of_raw",
        "environments",
        "cores_used",
    }
    assert all(value > 0 for value in figures.values())
    assert figures["environments"] == 32
