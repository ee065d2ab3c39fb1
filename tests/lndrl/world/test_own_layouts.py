"""Layouts of a generator of one's own: the same on every machine, furnished, validated."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import pytest

from lndrl.cli.runs import _check_place
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.models import effective
from lndrl.scenario import Scenario
from lndrl.world import Place
from lndrl.world.layouts import generate

Write = Callable[..., str]
TEXT = """
    from lndrl.scenario import Obstacle

    class Pillars:
        def __init__(self, scenario, count=4):
            self.scenario, self.count = scenario, count

        def __call__(self, layout, random):
            places = random.uniform(2.0, 12.0, (self.count, 2))
            return {answer}
"""
PILLARS = (
    "self.scenario.model_copy(update={'obstacles': "
    "[Obstacle(circle=(x, y, 0.3)) for x, y in places.tolist()]})"
)


def made_scenario(generator: str, **settings: Any) -> Scenario:
    return Scenario.model_validate(
        {
            "name": "pillars",
            "kind": "random",
            "size": [14.0, 14.0],
            "resolution": 0.1,
            "random": {"generator": generator, "layouts": 9, "settings": settings},
            "pedestrians": {"count": [2, 3]},
        }
    )


def test_a_layout_is_a_function_of_its_number(own_module: Write) -> None:
    name = f"{own_module(TEXT.format(answer=PILLARS))}:Pillars"
    scenario = made_scenario(name)
    one, again, other = (generate(scenario, k) for k in (3, 3, 4))
    assert one == again and one.obstacles != other.obstacles
    assert (one.kind, one.name, len(one.obstacles)) == ("geometry", "pillars-3", 4)
    assert one.robot and one.pedestrians.routes
    assert generate(scenario, 12) == one  # modulo layouts
    seeded = scenario.random.model_copy(update={"seed": 2})  # type: ignore[union-attr]
    reseeded = generate(scenario.model_copy(update={"random": seeded}), 3)
    assert reseeded.obstacles != one.obstacles
    assert len(generate(made_scenario(name, count=2), 3).obstacles) == 2
    Place.build(scenario, layout=3)


def test_its_own_tasks_and_routes_stay(own_module: Write) -> None:
    answer = """self.scenario.model_copy(update={
                'robot': [{'start': (1, 1, 2, 2), 'goal': (11, 11, 12, 12)}],
                'pedestrians': {'count': (1, 1), 'routes': [
                    {'start': (1, 11, 2, 12), 'goal': (11, 1, 12, 2)}]}})"""
    name = own_module(TEXT.format(answer=answer))
    layout = generate(made_scenario(f"{name}:Pillars"), 0)
    assert layout.start_goal_distance is None
    assert list(layout.robot[0].start) == [1, 1, 2, 2]
    assert layout.pedestrians.count == (1, 1) and len(layout.pedestrians.routes) == 1


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        ("places", "layout 2 must be a Scenario, not ndarray"),
        ("self.scenario.model_copy(update={'size': (-1, 2)})", r"layout 2: size \[-1"),
        ("self.scenario.model_copy(update={'obstacles': [{'box': (2, 2, 1, 1)}]})", "must be"),
        ("self.scenario.model_copy(update={'map': 'a.yaml'})", "layout 2 is a map"),
        ("self.scenario.model_copy(update={'pedestrians': [1]})", "layout 2: pedestrians ="),
        ("self.scenario.model_copy(update={'pedestrians': {'cuont': (1, 2)}})", "unknown key"),
        ("self.scenery", "failed: AttributeError: 'Pillars' object has no attribute 'scenery'"),
        (
            "self.scenario.model_copy(update={'obstacles': [Obstacle(box=(0, 0, 14, 14))]})",
            "none of 20 attempts at layout 2 offers room",
        ),
    ],
)
def test_a_wrong_layout_is_one_sentence(own_module: Write, answer: str, sentence: str) -> None:
    name = own_module(TEXT.format(answer=answer))
    with pytest.raises(UserError, match=sentence) as caught:
        generate(made_scenario(f"{name}:Pillars"), 2)
    assert "\n" not in str(caught.value)


def test_the_learner_names_it_and_worlds_import_it(own_module: Write) -> None:
    module = own_module(TEXT.format(answer=PILLARS), trusted=False)
    scenario = made_scenario(f"{module}:Pillars")
    _check_place(RunConfig(scenario=scenario))
    assert module not in sys.modules
    with pytest.raises(UserError, match=rf"random\.generator: scenario generator {module}"):
        Place.build(scenario)


@pytest.mark.parametrize(
    ("random", "sentence"),
    [
        ({"settings": {"a": 1}}, "settings go to a generator of your own"),
        ({"generator": "a:B", "mix": {"rooms": 0}}, "mix belongs to generator: blocks"),
        ({"generator": "a b"}, "names no part"),
    ],
)
def test_keys_that_do_not_go_together(random: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Scenario.model_validate({"name": "a", "kind": "random", "size": [14, 14], "random": random})


def test_the_built_in_generator_leaves_hashes_as_they_were() -> None:
    plain = Scenario.model_validate({"name": "a", "kind": "random", "size": [14, 14], "random": {}})
    assert plain.random is not None and set(effective(plain.random)) == {"seed", "layouts", "mix"}
