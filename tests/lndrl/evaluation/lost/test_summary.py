"""From traces made by hand to kinds, figures and hazards."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lndrl.evaluation.hazard import Hazard
from lndrl.evaluation.lost import Limits, LostReport, Trace, lost_tables, summary_lines
from lndrl.evaluation.lost.summary import (
    BEFORE,
    FIGURES,
    HEADING_STEPS,
    TURNED_STEPS,
    before_losses,
    cells_of,
    exposure_of,
    figures_of,
    foretold,
    hazards,
    heading_before,
    loss_of,
    turned,
    typical,
    usual_figures,
)
from lndrl.navigation.training.replicas import heading_risk
from tests.lndrl.evaluation.lost.traces import trace_of

AT_ONCE = Limits(2.0, math.pi / 4)
ONE_LATE = Limits(2.0, math.pi / 4, delay=1)


@pytest.mark.parametrize(
    ("off", "limits", "kind", "moment"),
    [
        ([0.1, 0.2, 0.3, 9.0], AT_ONCE, "jump", 3),
        ([0.1, 0.2, 0.99, 9.0], AT_ONCE, "jump", 3),
        ([0.1, 0.2, 1.01, 9.0], AT_ONCE, "drift", 3),
        ([0.5, 1.0, 1.5, 2.1], AT_ONCE, "drift", 3),
        # What is heard a step late was far off a step before the end: it had jumped even then.
        ([0.1, 0.3, 9.0, 9.1], ONE_LATE, "jump", 2),
        ([0.1, 1.3, 9.0, 9.1], ONE_LATE, "drift", 2),
        # Judged at once although it is heard late: the report of the last step did it.
        ([0.1, 0.2, 0.3, 9.0], ONE_LATE, "jump", 3),
    ],
)
def test_a_jump_is_near_one_report_before(
    off: list[float], limits: Limits, kind: str, moment: int
) -> None:
    loss = loss_of(trace_of("lost", off), limits)
    assert (loss.kind, loss.moment, loss.steps) == (kind, moment, 3)
    assert loss.position_error == off[moment] and loss.position_error_before == off[moment - 1]
    assert (loss.x, loss.y, loss.y_estimated) == (0.5 * moment, 0.0, off[moment])


def test_which_limit_was_passed() -> None:
    away = [0.0, 0.1, 1.0]
    cases = {
        "distance": trace_of("lost", [0.0, 0.0, 2.5]),
        "angle": trace_of("lost", [0.0, 0.0, 1.9], yaw_estimated=away),
        "both": trace_of("lost", [0.0, 0.0, 2.5], yaw_estimated=away),
    }
    for limit, trace in cases.items():
        assert loss_of(trace, AT_ONCE).limit == limit
    # 1.9 m off when it was said, 2.1 m off when it was heard half a metre farther on.
    late = trace_of("lost", [0.0, 1.9, 1.9, 1.9])
    loss = loss_of(late, ONE_LATE)
    assert (loss.limit, loss.moment, loss.kind) == ("delay", 2, "drift")


def test_angles_near_half_a_turn_are_not_far_apart() -> None:
    trace = trace_of("lost", [0.0, 3.0], yaw=[3.1, 3.1], yaw_estimated=[-3.1, -3.1])
    assert loss_of(trace, AT_ONCE).angle_error == pytest.approx(2 * math.pi - 6.2)
    assert loss_of(trace, AT_ONCE).limit == "distance"


def test_an_episode_that_is_lost_at_its_first_step() -> None:
    loss = loss_of(trace_of("lost", [0.0, 9.0]), ONE_LATE)
    assert (loss.moment, loss.kind) == (1, "jump")
    assert before_losses([trace_of("lost", [0.0, 9.0])], ONE_LATE).shape == (1, BEFORE + 1, 8)


def test_turning_adds_left_and_right_over_the_last_steps() -> None:
    yaw = np.concatenate([np.arange(6) * 0.3, np.full(20, 1.5), [1.3]])
    found = turned(yaw)
    assert found[0] == 0.0 and found[5] == pytest.approx(1.5)
    assert found[TURNED_STEPS] == pytest.approx(1.5)
    assert found[TURNED_STEPS + 2] == pytest.approx(0.9)
    assert found[-2] == 0.0 and found[-1] == pytest.approx(0.2)
    across = np.array([3.0, -3.0, 3.0])  # over half a turn and back
    assert turned(across)[-1] == pytest.approx(2 * (2 * math.pi - 6.0))


def test_the_heading_is_looked_at_some_steps_before() -> None:
    yaw = 0.1 * np.arange(10.0)
    off = np.array([0.5, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0])
    trace = trace_of("lost", [0.0] * 10, yaw=yaw, yaw_estimated=yaw - off)
    found = heading_before(trace)
    assert found[: HEADING_STEPS + 1] == pytest.approx([0.5] * (HEADING_STEPS + 1))
    assert found[HEADING_STEPS + 1 :] == pytest.approx([0.0, 0.0, 0.2])
    exposure = exposure_of([trace], ["room"], AT_ONCE)
    assert exposure.heading[-1] == pytest.approx(0.2)
    # Across half a turn it is the short way that counts.
    round_the_back = trace_of("lost", [0.0] * 7, yaw=3.1, yaw_estimated=-3.1)
    assert heading_before(round_the_back)[-1] == pytest.approx(2 * math.pi - 6.2)


def test_headings_tell_of_losses_as_a_training_pays_for_them() -> None:
    off = np.array([9.0, 0.0, 0.115, -0.115, 1.0])  # the start was nobody's doing
    trace = trace_of("lost", [0.0] * 5, yaw=1.0, yaw_estimated=1.0 - off)
    pose = np.zeros(3)
    paid = [heading_risk(pose, np.array([0.0, 0.0, error])) for error in off[1:]]
    assert paid == pytest.approx([0.0, 1 / 96, 1 / 96, 1 / 12])
    assert foretold([trace, trace]) == pytest.approx(2.0 * sum(paid))
    assert report_of([trace]).to_dict()["foretold"] == pytest.approx(sum(paid))


@given(st.lists(st.floats(-0.9, 0.9), min_size=0, max_size=40))
def test_turning_matches_its_slow_twin(changes: list[float]) -> None:
    yaw = np.concatenate([[0.0], np.cumsum(changes)])
    wrapped = (yaw + np.pi) % (2 * np.pi) - np.pi
    slow = [sum(map(abs, changes[max(i - TURNED_STEPS, 0) : i])) for i in range(len(yaw))]
    assert turned(wrapped) == pytest.approx(np.array(slow), abs=1e-9)


def test_figures_before_a_loss_end_with_it() -> None:
    off = [*(0.01 * k for k in range(20)), 9.0, 9.1]
    second = [0.0] * 18 + [0.1, 0.2, 0.6, 0.7]
    trace = trace_of("lost", off, second_cluster=second)
    found = before_losses([trace, trace_of("arrived", [0.0] * 9)], ONE_LATE)
    assert found.shape == (1, BEFORE + 1, len(FIGURES))
    assert found[0, :, FIGURES.index("position_error")] == pytest.approx(off[10:21])
    assert found[0, :, FIGURES.index("second_cluster")] == pytest.approx(second[10:21])
    short = before_losses([trace_of("lost", [0.1, 0.2, 9.0])], AT_ONCE)
    assert np.isnan(short[0, :-3]).all()
    assert short[0, -3:, 0] == pytest.approx([0.1, 0.2, 9.0])


def test_cleared_averages_have_no_ratio_and_are_injections_once_something_was_heard() -> None:
    trace = trace_of(
        "arrived",
        [0.0] * 5,
        slow_average=[0.0, 0.0, 0.02, 0.0, 0.01],
        fast_average=[0.0, 0.0, 0.05, 0.0, 0.01],
    )
    found = figures_of(trace)
    ratio, injected = (found[:, FIGURES.index(name)] for name in ("ratio", "injected"))
    assert np.isnan(ratio[[0, 1, 3]]).all() and ratio[[2, 4]] == pytest.approx([2.5, 1.0])
    assert injected.tolist() == [0.0, 0.0, 0.0, 1.0, 0.0]


def test_usual_figures_are_those_of_steps_of_who_was_not_lost() -> None:
    traces = [
        trace_of("arrived", [5.0, 0.1, 0.2, 0.3]),  # the start is no step
        trace_of("collided", [5.0, 0.4, 0.5]),
        trace_of("lost", [0.0, 9.0, 9.0]),
    ]
    figures, steps = usual_figures(traces)
    assert steps == 5 and figures[0].median == pytest.approx(0.3)
    assert figures[0].mean == pytest.approx(0.3)
    nothing, steps = usual_figures([trace_of("lost", [0.0, 9.0])])
    assert steps == 0 and math.isnan(nothing[0].median)


def test_typical_leaves_out_what_is_not_known() -> None:
    (found,) = typical(np.array([[np.nan], [1.0], [2.0], [3.0], [np.inf]]))
    assert found == pytest.approx((1.5, 2.0, 2.5, 2.0))


@given(
    st.lists(st.tuples(st.floats(-1, 5), st.booleans()), max_size=60),
    st.lists(st.floats(0, 4), min_size=1, max_size=5, unique=True).map(sorted),
)
def test_hazards_match_their_slow_twin(cases: list[tuple[float, bool]], edges: list[float]) -> None:
    values = np.array([value for value, _ in cases], np.float64)
    lost = np.array([flag for _, flag in cases], np.bool_)
    ends = [-math.inf, *edges, math.inf]
    slow = []
    for low, high in pairwise(ends):
        inside = [flag for value, flag in cases if low <= value < high]
        slow.append(Hazard(sum(inside), len(inside)))
    assert hazards(values, lost, edges) == slow


def test_a_step_counts_with_the_moment_that_its_report_describes() -> None:
    echoes = [0.1, 0.2, 0.3, 0.4, 0.5]
    kept = trace_of("arrived", [0.0] * 5, echoes=echoes)
    lost = trace_of("lost", [0.0, 0.0, 0.0, 9.0, 9.0], echoes=echoes, scenario="hall")
    exposure = exposure_of([kept, lost], ["room", "hall"], ONE_LATE)
    assert exposure.echoes == pytest.approx([0.1, 0.2, 0.3, 0.4] * 2)
    assert exposure.lost.tolist() == [False] * 7 + [True]
    assert exposure.place.tolist() == [0] * 4 + [1] * 4
    assert exposure.x[-1] == 1.5  # where the report was made
    judged_at_once = trace_of("lost", [0.0, 0.0, 0.0, 0.0, 9.0])
    assert exposure_of([judged_at_once], ["room"], ONE_LATE).x.tolist() == [0.0, 0.5, 1.0, 2.0]
    at_once = exposure_of([kept], ["room"], AT_ONCE)
    assert at_once.echoes == pytest.approx([0.2, 0.3, 0.4, 0.5])


def test_cells_hold_every_step_once() -> None:
    traces = [
        trace_of("lost", [0.0] * 9 + [9.0]),
        trace_of("arrived", [0.0] * 7, y=-0.1),
        trace_of("arrived", [0.0] * 5, scenario="hall"),
    ]
    exposure = exposure_of(traces, ["room", "hall"], AT_ONCE)
    cells = {(cell.x, cell.y): cell.hazard for cell in cells_of(exposure, 0)}
    assert cells == {
        (0.0, 0.0): Hazard(0, 3),
        (2.0, 0.0): Hazard(0, 4),
        (4.0, 0.0): Hazard(1, 2),
        (0.0, -2.0): Hazard(0, 3),
        (2.0, -2.0): Hazard(0, 3),
    }
    assert cells_of(exposure_of(traces, ["room", "hall", "empty"], AT_ONCE), 2) == []


def report_of(traces: list[Trace], limits: Limits = AT_ONCE) -> LostReport:
    return LostReport("dwa", "a world", 0, ("room", "hall"), limits, traces)


def test_without_a_lost_episode_the_hazard_still_has_a_bound() -> None:
    report = report_of([trace_of("arrived", [0.1] * 501), trace_of("timeout", [0.1] * 501)])
    (line,) = summary_lines(report)
    assert line == (
        "none of 2 episodes was lost in 1,000 control steps: the hazard lies between 0 and 3.69 "
        "per 1,000 (95 %)"
    )
    assert len(lost_tables(report)) == 2  # there is nothing before a loss
    data = report.to_dict()
    assert data["losses"] == [] and data["kinds"]["jump"]["share"] is None
    assert data["hazard"]["interval"] == pytest.approx([0.0, 3.689], abs=1e-3)
    assert data["before"][0]["ratio"]["median"] is None
    assert data["not_lost"]["position_error"]["median"] == pytest.approx(0.1)


def test_shares_and_counts_agree_in_all_that_is_said() -> None:
    traces = [
        trace_of("lost", [0.1, 0.1, 9.0], turn=0.5),
        trace_of("lost", [0.1, 0.1, 9.0], episode=1),
        trace_of("lost", [0.1, 1.6, 2.2], episode=2),
        trace_of("arrived", [0.1] * 40, episode=3, scenario="hall"),
    ]
    report = report_of(traces)
    assert report.kinds == {"jump": 2, "drift": 1}
    data = report.to_dict()
    assert data["kinds"]["jump"]["share"] == pytest.approx(2 / 3)
    assert data["limits_passed"]["distance"]["count"] == 3
    assert data["hazard"]["steps"] == 45 and data["hazard"]["lost"] == 3
    for bins in data["hazard_by"].values():
        assert sum(each["lost"] for each in bins) == 3
        assert sum(each["steps"] for each in bins) == 45
    by_turning = {each["from"]: each["lost"] for each in data["hazard_by"]["turned"]}
    assert by_turning[None] == 2 and by_turning[1.0] == 1
    assert [each["hazard"]["lost"] for each in data["scenarios"]] == [3, 0]
    assert len(data["losses"][0]["before"]["second_cluster"]) == BEFORE + 1
    assert "jumps 2 " in summary_lines(report)[1] and "drifts 1;" in summary_lines(report)[1]
