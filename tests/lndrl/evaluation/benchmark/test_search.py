"""The search for the bench's readings: who is dropped, who is judged, and by what."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import pytest

from lndrl.cli.main import run as lndrl
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import PAPER, load_benchmark, load_calibration
from lndrl.evaluation.benchmark import search as search_module
from lndrl.evaluation.benchmark.calibration import CalibrationSpec, Target
from lndrl.evaluation.benchmark.figures import Row
from lndrl.evaluation.benchmark.halving import Search
from lndrl.evaluation.benchmark.search import (
    Verdict,
    World,
    excluded_by,
    farness,
    missed_by,
    row_targets,
    spread_of,
    standard_error,
    worlds_of,
)
from lndrl.models import validate
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.episode import Outcome
from lndrl.navigation.families import Family
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.planners import behaviour, behaviour_hash

FACTORS = {
    "slip": {"why": "open", "values": {"firm": {"set": ["a=1"]}, "loose": {"set": ["a=2"]}}},
    "delay": {
        "why": "open",
        "values": {
            "prompt": {"set": ["b=0"]},
            "late": {"set": ["b=1"], "only": {"hall": ["c=1"]}},
            "later": {},
        },
    },
}


def made_spec(**search: object) -> CalibrationSpec:
    data = {
        "scenarios": ["sparse"],
        "variants": {"as_is": {"why": "nothing"}},
        "search": {"factors": FACTORS, **search},
    }
    return validate(CalibrationSpec, data, "calibration.yaml")


def made_row(
    method: str = "dwa",
    ends: tuple[int, int, int, int] = (631, 322, 35, 12),
    steps: int = 55,
    time: float = 23.82,
    error: float = 0.3083,
) -> Row:
    """``ends``: arrived, collided, lost, stuck; all else as in the paper's row."""
    outcomes = [
        name
        for name, count in zip(("arrived", "collided", "lost", "timeout"), ends, strict=True)
        for _ in range(count)
    ]
    parts = dict.fromkeys(REWARD_PARTS, 0.0)
    records = {
        ("sparse", k): EpisodeRecord(
            Family.CALIBRATION.world(k), 0, cast(Outcome, outcome), steps,
            time + 0.1 * (k % 3 - 1), 11.19, error, 0.1257, 0.5144, 0.0, parts,
        )
        for k, outcome in enumerate(outcomes)
    }  # fmt: skip
    return Row(method, ("sparse",), records)


def test_none_lost_is_not_taken_for_certain() -> None:
    error = standard_error(made_row(ends=(140, 60, 0, 0)).metrics, "lr")
    assert error == pytest.approx((2 / 204 * 202 / 204 / 200) ** 0.5)


def test_every_combination_is_a_world() -> None:
    spec = made_spec()
    assert spec.search is not None
    worlds = worlds_of(spec.search)
    assert [world.name for world in worlds] == [
        "firm+prompt", "firm+late", "firm+later", "loose+prompt", "loose+late", "loose+later",
    ]  # fmt: skip
    assert worlds[4].changes("sparse") == ["a=2", "b=1"]
    assert worlds[4].changes("hall") == ["a=2", "b=1", "c=1"]


def test_some_of_many_are_drawn_and_always_the_same() -> None:
    spec = made_spec(worlds=4)
    assert spec.search is not None
    names = [world.name for world in worlds_of(spec.search)]
    assert len(set(names)) == 4 and names == [world.name for world in worlds_of(spec.search)]
    other = made_spec(worlds=4, seed=8)
    assert other.search is not None and names != [w.name for w in worlds_of(other.search)]
    fewer = made_spec(worlds=2)
    assert fewer.search is not None and {w.name for w in worlds_of(fewer.search)} < set(names)
    many = made_spec(worlds=100)
    assert many.search is not None and len(worlds_of(many.search)) == 6


@pytest.mark.parametrize(
    ("search", "words"),
    [
        ({"seed": 5, "judge_seed": 5}, "judge_seed must differ from seed"),
        ({"factors": {"a": FACTORS["slip"], "b": FACTORS["slip"]}}, "twice: firm, loose"),
        ({"factors": {"a": {"why": "x", "values": {"a/b": {}}}}}, "a/b"),
        ({"factors": {"a": {"why": "x", "values": {"..": {}}}}}, r"\.\."),
        ({"factors": {"a": {"why": "x", "values": {"judged": {}}}}}, "cannot be called judged"),
        ({"rounds": [160, 40]}, r"rounds \[160, 40\] must ascend"),
    ],
)
def test_a_search_that_cannot_be_kept_apart_is_refused(
    search: dict[str, object], words: str
) -> None:
    with pytest.raises(UserError, match=words):
        made_spec(**search)


def test_the_papers_own_row_meets_everything() -> None:
    row = made_row()
    assert missed_by(row) == [] and excluded_by(row) == [] and farness(row) == 0.0
    assert {t.name for t in row_targets()} == set(row.to_dict()) & set(vars(PAPER["dwa"])) - {
        "variance_sum"
    }
    lost = next(t for t in row_targets() if t.name == "lr")
    assert (lost.least, lost.most) == (0.02, 0.05)


def test_only_what_is_excluded_at_two_deviations_is_dropped() -> None:
    few = made_row(ends=(60, 36, 4, 0))  # 0.60: its standard error is 0.05
    assert excluded_by(few) == []
    off = made_row(ends=(53, 43, 4, 0))  # CR 0.43, allowed to 0.372: 1.2 standard errors
    assert "CR" in missed_by(off) and excluded_by(off) == []
    assert "CR" in excluded_by(made_row(ends=(530, 430, 40, 0)))  # the same of ten times as many
    assert "e_p (m)" in excluded_by(made_row(ends=(60, 36, 4, 0), error=0.6))
    assert farness(off) > 0.0


def test_nothing_is_held_against_a_figure_that_nobody_has() -> None:
    nobody = made_row(ends=(0, 20, 0, 0))  # nobody arrived: no time, no distance
    assert "t (s)" not in excluded_by(nobody) and "AR" in excluded_by(nobody)
    assert "t (s)" in missed_by(nobody)


def verdict(careful: int, predictive: int, **dwa: object) -> Verdict:
    rows = {
        "dwa": made_row(**dwa),  # type: ignore[arg-type]
        "careful": made_row("careful", (1000 - careful, 0, careful, 0), steps=60),
        "predictive": made_row("predictive", (1000 - predictive, 0, predictive, 0)),
    }
    return Verdict(World((("slip", f"{careful}"),), ()), rows)


def test_behaviour_matters_by_hazard_not_by_episodes() -> None:
    assert verdict(7, 46).ratio("careful")[0] == pytest.approx(7 / 60 / (35 / 55))
    assert verdict(7, 46).matters and not verdict(8, 46).matters and not verdict(7, 45).matters
    low, high = verdict(7, 46).ratio("careful")[1]
    assert 0.05 < low < 0.18 < high < 0.5
    assert Verdict(World((), ()), {"dwa": made_row()}).matters is None


def test_the_row_comes_before_what_we_wish_for() -> None:
    good, tame = verdict(3, 60), verdict(20, 60)
    wrong = verdict(0, 90, ends=(700, 200, 60, 40))
    assert sorted([wrong, tame, good], key=Verdict.order) == [good, tame, wrong]
    assert spread_of([wrong, tame, good], "careful") == [
        good.ratio("careful")[0], tame.ratio("careful")[0],
    ]  # fmt: skip


def test_a_planner_that_was_changed_is_refused(tmp_path: Path) -> None:
    spec = made_spec(planners={"straight": behaviour_hash("straight")})
    Search(spec, load_benchmark(), tmp_path)
    changed = made_spec(planners={"straight": "0123"})
    with pytest.raises(UserError, match="planner straight has changed: what it does has the hash"):
        Search(changed, load_benchmark(), tmp_path)


def test_the_repositorys_planners_are_those_that_the_worlds_were_judged_with() -> None:
    spec = load_calibration()
    assert spec.search is not None
    for name, frozen in spec.search.planners.items():
        assert behaviour_hash(name) == frozen, name


def test_behaviour_is_what_is_hashed() -> None:
    hashes = {name: behaviour_hash(name) for name in ("straight", "random", "dwa", "predictive")}
    assert len(set(hashes.values())) == 4
    assert behaviour_hash("straight") == hashes["straight"]


def test_another_bench_makes_no_other_planner(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frozen = behaviour_hash("careful")
    shipped = (behaviour.REPOSITORY_CONFIGS / "lndrl.yaml").read_text("utf-8")
    world = "localization: {delay: 2}\nworld: {tick: 0.2, ticks_per_step: 2}\n"
    (tmp_path / "lndrl.yaml").write_text(shipped + world)
    monkeypatch.setattr(behaviour, "REPOSITORY_CONFIGS", tmp_path)
    assert behaviour_hash("careful") == frozen


SPEC = """
scenarios: [sparse]
variants: {as_is: {why: nothing}}
search:
  rounds: [8]
  judged: 16
  factors:
    wheels:
      why: nobody says
      values:
        firm: {set: [world.odometry_deviation=0.0]}
        loose: {set: [world.odometry_deviation=0.5]}
"""


def test_the_command_drops_judges_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("search.yaml").write_text(SPEC)
    planners = f"  planners: {{straight: '{behaviour_hash('straight')}'}}\n"
    Path("search.yaml").write_text(SPEC + planners)
    keeps = Target("lr", "LR", 0.0, 0.0, 0.2)  # few get lost on firm wheels, most on loose ones

    def easy() -> Sequence[Target]:
        return [keeps]

    monkeypatch.setattr(search_module, "row_targets", easy)
    common = ["calibrate", "search.yaml", "--search", "--workers", "0"]
    assert lndrl([*common, "--json"]) == 0
    printed = capsys.readouterr()
    (judged,) = json.loads(printed.out)
    assert judged["world"] == "firm" and judged["meets_row"]
    assert set(judged["rows"]) == {"dwa", "straight"}
    assert judged["rows"]["dwa"]["episodes"] == 16
    assert "2 worlds, 8 episodes" in printed.err
    found = json.loads(Path("results/calibration/search/search.json").read_text())
    assert found["worlds"] == ["firm", "loose"] and found["dropped"] == {"loose": "8: LR"}
    assert lndrl([*common, "--table"]) == 0
    shown = capsys.readouterr()
    assert shown.err == "" and "2 worlds, 1 judged, 1 meet DWA's row" in shown.out
    assert lndrl([*common, "--table", "--name", "other"]) == 2
    assert "no world has been judged; run it without --table" in capsys.readouterr().err
    # Judged by episodes of a seed that no round had, and by all of them or not at all.
    rounds, judged = (
        Path("results/calibration/search", *p) for p in (["firm"], ["judged", "firm"])
    )
    seeds = [json.loads((each / "benchmark.json").read_text())["seed"] for each in (rounds, judged)]
    assert seeds == [2000, 2001]
    episodes = judged / "dwa-sparse.csv"
    episodes.write_text("".join(episodes.read_text().splitlines(keepends=True)[:-1]))
    assert lndrl([*common, "--table"]) == 2
    assert "no world has been judged" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("search", "more", "words"),
    [
        ("", [], "bad.yaml: search is missing"),
        ("{factors: {f: {why: x, values: {a: {}}}}}", ["--variants", "as_is"], "--variants as_is"),
        ("{factors: {f: {why: x, values: {a: {}}}}}", ["--by-scenario"], "--by-scenario goes with"),
        (
            "{factors: {f: {why: x, values: {odd: {set: [localization.dely=1]}}}}}",
            [],
            "search: world odd: ",
        ),
        (
            "{planners: {nobody: '0'}, factors: {f: {why: x, values: {a: {}}}}}",
            [],
            "search.planners: nobody: no such run folder",
        ),
    ],
)
def test_what_is_wrong_with_a_search_is_said(
    search: str,
    more: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    text = "scenarios: [sparse]\nvariants: {as_is: {why: nothing}}\n"
    Path("bad.yaml").write_text(text + (f"search: {search}\n" if search else ""))
    assert lndrl(["calibrate", "bad.yaml", "--search", "--workers", "0", *more]) == 2
    error = capsys.readouterr().err
    assert words in error and len(error.strip().splitlines()) == 1
