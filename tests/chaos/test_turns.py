"""What floods cost, from marks made by hand on a machine that drifts."""

from __future__ import annotations

from itertools import islice

import pytest

from lndrl.chaos.flood import Sent
from lndrl.chaos.turns import CALM, FLOOD, Cost, Flood, Mark, cost, durations, read


def drifting(slower: float = 1.0, more: float = 0.0) -> tuple[list[Mark], list[Flood], float]:
    """Ten floods of 12 s between calms of 6 s, on a machine that loses half its speed.

    An update of 10 samples takes 0.1 s of CPU at first, a flood makes it ``slower`` and takes
    ``more`` CPU s per second.
    """
    floods = [Flood(18.0 * n + 6.0, 18.0 * n + 18.0, 1200) for n in range(10)]
    end = 18.0 * 10 + 6.0
    marks: list[Mark] = []
    now, cpu = 0.0, 0.0
    while now <= end:
        wild = any(flood.begin <= now < flood.end for flood in floods)
        slow = 1.0 + now / end
        cpu += 0.1 * slow + (0.2 * slow * slower * more if wild else 0.0)
        now += 0.2 * slow * (slower if wild else 1.0)
        marks.append(Mark(now, 10 * (len(marks) + 1), cpu))
    return marks, floods, end


def test_a_flood_that_costs_nothing_costs_nothing_while_the_machine_drifts() -> None:
    marks, floods, end = drifting()
    found = cost(marks, floods, 0.0, end)
    assert found.ratio == pytest.approx(1.0, abs=0.02)
    assert found.least is not None and found.most is not None
    assert found.least < 1.0 < found.most
    assert found.ms_per_message == pytest.approx(0.0, abs=0.1)
    assert found.flood is not None and found.calm is not None
    assert 25.0 < found.flood < 50.0 and 25.0 < found.calm < 50.0


def test_what_a_flood_costs_is_found_while_the_machine_drifts() -> None:
    marks, floods, end = drifting(slower=1.25, more=0.05)
    found = cost(marks, floods, 0.0, end)
    assert found.ratio == pytest.approx(0.8, abs=0.02)
    assert found.ms_per_message == pytest.approx(0.5, abs=0.05), "50 ms/s of 100 messages/s"


def test_a_turn_is_read_from_update_to_update_once_it_settled() -> None:
    marks = [Mark(float(n), 10 * n, 0.5 * n) for n in range(20)]
    reading = read(marks, 4.5, 9.9)
    assert reading is not None
    assert (reading.seconds, reading.samples, reading.cpu) == (3.0, 30, 1.5)
    assert (reading.rate, reading.cpu_per_sample) == (10.0, 0.05)
    assert read(marks, 4.5, 6.9) is None, "one update alone"
    assert read([], 0.0, 9.0) is None


def test_nothing_to_compare_is_no_figure() -> None:
    assert cost([], [Flood(5.0, 9.0, 100)], 0.0, 15.0) == Cost()
    assert cost([], [], 0.0, 15.0) == Cost()


def test_turns_follow_from_the_seed() -> None:
    one, other = (list(islice(durations(seed), 50)) for seed in (3, 4))
    assert one == list(islice(durations(3), 50)) != other
    assert all(CALM[0] <= calm <= CALM[1] for calm, _ in one)
    assert all(FLOOD[0] <= flood <= FLOOD[1] for _, flood in one)


def test_what_was_sent_survives_the_pipe() -> None:
    sent = Sent(7, floods=[Flood(1.0, 2.5, 7)])
    sent.answers["refused"] += 6
    sent.kinds["upload"] += 7
    sent.taken.append("upload, noise: accepted")
    assert Sent.read(sent.to_json()) == sent
