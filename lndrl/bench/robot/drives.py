"""Drives through a stand-in in another process, timed, and held against ``lndrl evaluate``."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.evaluation import evaluate, settings_for
from lndrl.evaluation.benchmark.results.paired import paired_interval
from lndrl.machine.cores import allowed_cores, machine_cores
from lndrl.machine.threads import kept_threads, set_threads
from lndrl.planners import PlannerSource, planner_source
from lndrl.robot.driving import DriveService, Pilot
from lndrl.robot.driving.assembly import DriveOptions, drive_config, make_pilot, make_service
from lndrl.robot.link import Address, Link, open_link
from lndrl.robot.messages import Velocity
from lndrl.transport.zenoh.session import free_endpoint
from lndrl.view.progress import Advance, progress_bar

POLICY, SCENARIO = "shipped", "hall"
_STARTS_WITHIN = 300.0
"""s for the stand-in to load, and to compile where that was never done."""
_MUTED = 1.0
_DROVE_BEFORE = 3.0
"""s of silence, and of driving before each."""
_LONGEST_EPISODE = 300.0
"""s of ours that an episode may take before a comparison is given up."""


def measure(seconds: float, episodes: int = 0) -> dict[str, Any]:
    """Figures of the shipped policy with the filter it was trained with, in hall, over loopback.

    ``scan_to_command_milliseconds``: from a scan's arrival to the command that was decided on it,
    of which localization and policy are a part; this process is held on one core. The stand-in
    lives in another process. ``stale_to_stop_seconds``: from the last scan's arrival to the stop,
    while the stand-in's scanner falls silent every few seconds, in real time; to be held against
    ``control_period_seconds``. With ``episodes``: ``comparison``, see ``compare``.
    """
    source, config = _driven()
    with _on_one_core():
        pilot = make_pilot(source, config, DriveOptions())
        figures: dict[str, Any] = {
            "scan_to_command_milliseconds": _latency(pilot, seconds),
            "stale_to_stop_seconds": _stale(pilot, seconds),
            "control_period_seconds": pilot.period,
        }
    if episodes:
        figures["comparison"] = compare(episodes)
    return figures


def compare(episodes: int, seed: int = 0) -> dict[str, Any]:
    """The same policy in the same ``episodes``, driven through the stand-in and by ``evaluate``.

    Rates of each, and the paired 95 % interval of the difference (driven less evaluated), for
    arriving and for colliding. Both hear the pose at once. Says how far it is. Raises UserError
    where the stand-in ends early.
    """
    source, config = _driven()
    config = config.model_copy(update={"seed": seed})
    pilot = make_pilot(source, config, DriveOptions())
    began = time.monotonic()
    with progress_bar(episodes, "driven", "episodes") as advance:
        driven = _rehearsed(pilot, episodes, seed, advance)
    took = time.monotonic() - began
    with progress_bar(episodes, "evaluated", "episodes") as advance:
        evaluated = evaluate(
            source, config, episodes, seed, workers=0, progress=lambda record: advance()
        ).records
    by_episode = {each["episode"]: each["outcome"] for each in driven}
    found: dict[str, Any] = {"episodes": len(driven), "seconds_per_episode": took / episodes}
    for outcome in ("arrived", "collided", "lost", "timeout"):
        one = np.array([by_episode[k] == outcome for k in range(episodes)])
        other = np.array([record.outcome == outcome for record in evaluated])
        counts = (one & other, one & ~other, ~one & other, ~one & ~other)
        low, high = paired_interval(*(int(each.sum()) for each in counts))
        found[outcome] = {
            "driven": float(one.mean()),
            "evaluated": float(other.mean()),
            "difference": float(one.mean() - other.mean()),
            "interval_low": low,
            "interval_high": high,
        }
    return found


def _driven() -> tuple[PlannerSource, RunConfig]:
    source = planner_source(POLICY)
    return source, drive_config(settings_for(source, SCENARIO), DriveOptions())


@contextmanager
def _on_one_core() -> Iterator[None]:
    """Hold this process, all its threads to come and the policy's sums on one core."""
    before = allowed_cores()
    os.sched_setaffinity(0, before[:1])
    try:
        with kept_threads():
            set_threads(1)
            yield
    finally:
        os.sched_setaffinity(0, before)


@contextmanager
def _stand_in(*options: str) -> Iterator[tuple[Link, subprocess.Popen[str]]]:
    """A stand-in in a process of its own, and a link to it."""
    endpoint = free_endpoint()
    command = [sys.executable, "-m", "lndrl", "robot-sim", "--scenario", SCENARIO, "--listen",
               endpoint, *options]  # fmt: skip
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        encoding="utf-8",
        preexec_fn=_anywhere,
    )
    try:
        with _linked(endpoint, process) as link:
            yield link, process
    finally:
        process.terminate()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def _anywhere() -> None:
    os.sched_setaffinity(0, range(machine_cores()))


def _linked(endpoint: str, process: subprocess.Popen[str]) -> Link:
    until = time.monotonic() + _STARTS_WITHIN
    while True:
        try:
            return open_link(Address(endpoint, timeout=2.0), "lndrl_drive")
        except UserError:
            if process.poll() is not None or time.monotonic() > until:
                raise UserError("the stand-in does not start; try lndrl robot-sim") from None
            time.sleep(0.2)


def _latency(pilot: Pilot, seconds: float) -> dict[str, float]:
    with _stand_in("--fast") as (link, _):
        service = make_service(link, pilot, DriveOptions())
        until = time.monotonic() + seconds + 2.0
        service.run(threading.Event(), over=lambda: time.monotonic() > until)
    found = np.array(service.latencies) * 1000.0
    if not len(found):
        raise UserError("nothing was driven in that time; give --seconds more")
    median, high = np.percentile(found, [50, 99])
    return {"median": float(median), "p99": float(high), "decisions": len(found)}


def _stale(pilot: Pilot, seconds: float) -> dict[str, float]:
    times = max(1, int(seconds / (_DROVE_BEFORE + _MUTED)))
    mutes = []
    for k in range(times * 4):  # the first seconds go to whoever connects
        start = (k + 1) * (_DROVE_BEFORE + _MUTED)
        mutes += ["--mute", f"scan:{start:g}:{_MUTED:g}"]
    found: list[float] = []
    with _stand_in(*mutes, "--command-timeout", "5") as (link, _):
        service = make_service(link, pilot, DriveOptions())
        _watch_stops(service, found)
        until = time.monotonic() + times * 4 * (_DROVE_BEFORE + _MUTED)
        service.run(threading.Event(), over=lambda: len(found) >= times or time.monotonic() > until)
    if not found:
        raise UserError("no scan became stale while it drove; give --seconds more")
    return {"median": float(np.median(found)), "worst": max(found), "stops": len(found)}


def _watch_stops(service: DriveService, found: list[float]) -> None:
    """Note for every stop by a stale scan how old the last scan was when it went out."""
    driver = service.driver
    send: Callable[[str, Any], None] = driver.send
    drove = [False]

    def note(purpose: str, content: Any) -> None:
        send(purpose, content)
        if not isinstance(content, Velocity):
            return
        still = content.v == 0.0 and content.w == 0.0
        if still and drove[0] and any(s.reason.name == "SCAN_STALE" for s in driver.stops):
            age = driver.senses.age("scan", time.monotonic())
            if age is not None:
                found.append(age)
        drove[0] = not still

    driver.send = note


def _rehearsed(pilot: Pilot, episodes: int, seed: int, advance: Advance) -> list[dict[str, Any]]:
    """The episodes as the stand-in judges them; ``advance`` hears of each."""
    options = ("--fast", "--json", "--episodes", str(episodes), "--seed", str(seed))
    records: list[dict[str, Any]] = []
    with _stand_in(*options) as (link, process):
        service = make_service(link, pilot, DriveOptions(seed=seed))
        over, last = threading.Event(), [time.monotonic()]

        def read() -> None:
            assert process.stdout is not None
            for line in process.stdout:
                records.append(json.loads(line))
                last[0] = time.monotonic()
                advance()
            over.set()

        threading.Thread(target=read, name="lndrl-records", daemon=True).start()
        service.run(over, over=lambda: time.monotonic() - last[0] > _LONGEST_EPISODE)
    if len(records) != episodes:
        raise UserError(f"the stand-in ended after {len(records)} of {episodes} episodes")
    return records
