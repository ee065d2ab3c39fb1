"""A planner of one's own: named like any other, called with its settings, and watched."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lndrl.config import RunConfig, load_scenario
from lndrl.errors import UserError
from lndrl.navigation import Observation
from lndrl.planners import is_own_planner, is_rule, planner_source
from lndrl.planners.factory import RULES

Write = Callable[..., str]
CONFIG = RunConfig(scenario=load_scenario("hybrid"))
TEXT = """
    import numpy as np

    class Slow:
        name = "slow"
        def __init__(self, config, speed=0.2):
            self.speed = speed
        def reset(self, seed, worlds):
            self.worlds = list(worlds)
        def act(self, observation, rows):
            return {answer}
"""
GOOD = TEXT.format(answer="np.tile([self.speed, 0.0], (len(rows), 1))")


def act(source_name: str, rows: int = 2, **settings: object) -> np.ndarray:
    planner = planner_source(source_name, settings).build(CONFIG)  # type: ignore[arg-type]
    planner.reset(0, list(range(rows)))
    return planner.act(Observation.zeros_for(rows, CONFIG), np.arange(rows))


def test_it_is_built_with_its_settings(own_module: Write) -> None:
    name = f"{own_module(GOOD)}:Slow"
    assert act(name).tolist() == [[0.2, 0.0]] * 2
    assert act(name, speed=0.6).tolist() == [[0.6, 0.0]] * 2
    assert planner_source(name).label == "Slow"


def test_naming_it_imports_nothing(own_module: Write) -> None:
    module = own_module(GOOD, trusted=False)
    source = planner_source(f"{module}:Slow")
    assert is_own_planner(source.name) and is_rule(source.name) and module not in sys.modules
    with pytest.raises(UserError, match=f"planner {module}:Slow is refused"):
        source.build(CONFIG)


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        ("np.full((len(rows), 2), 0.7)", "asks for v = 0.7; this robot has 0 to 0.6"),
        ("np.tile([0.0, -1.0], (len(rows), 1))", "asks for w = -1; this robot has -0.9 to 0.9"),
        ("np.full((len(rows), 2), np.nan)", "asks for v = nan"),
        ("np.zeros(2)", r"must answer 2 observations with v and w for each, \(2, 2\), not \(2,\)"),
        ("observation.people", "failed: AttributeError"),
    ],
)
def test_a_wrong_answer_is_one_sentence(own_module: Write, answer: str, sentence: str) -> None:
    name = f"{own_module(TEXT.format(answer=answer))}:Slow"
    with pytest.raises(UserError, match=f"planner {name}.*{sentence}"):
        act(name)


def test_only_ones_own_takes_settings() -> None:
    with pytest.raises(UserError, match="straight: takes no settings"):
        planner_source("straight", {"speed": 0.3})


def test_an_installed_name_is_a_planner(own_module: Write, install: Callable[..., None]) -> None:
    module = own_module(GOOD, trusted=False)
    install("slow-planners", "lndrl.planners", "slow", f"{module}:Slow")
    assert act("slow", speed=0.4)[0, 0] == 0.4
    with pytest.raises(
        UserError, match=r"give one, shipped, random or .* or dwa or .* or slow, or module"
    ):
        planner_source("slaw")


def test_a_folder_of_an_installed_name_is_ambiguous(
    own_module: Write,
    install: Callable[..., None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    install("slow-planners", "lndrl.planners", "slow", "x:Slow")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slow").mkdir()
    with pytest.raises(UserError, match=r"slow: is a path here and an installed planner; write \."):
        planner_source("slow")


def test_rules_stay_rules() -> None:
    assert all(is_rule(name) and not is_own_planner(name) for name in RULES)
    assert not is_rule("runs/first")
