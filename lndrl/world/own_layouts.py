"""Layouts of a random scenario that are drawn by a class of a user's own."""

from __future__ import annotations

import numpy as np

from lndrl.errors import UserError
from lndrl.extensions import GENERATOR, calling, find, make
from lndrl.models import validate
from lndrl.scenario import BLOCKS, RandomLayouts, Scenario

_NOWHERE = {"start": (0.0, 0.0, 0.0, 0.0), "goal": (0.0, 0.0, 0.0, 0.0)}
_STREAM = 78  # keeps these draws apart from those of worlds and of the built-in generator


class OwnLayouts:
    """The generator that ``settings`` names, made for ``scenario``.

    Raises UserError where it is not trusted, not there, or not what it should be.
    """

    def __init__(self, scenario: Scenario, settings: RandomLayouts) -> None:
        self._scenario, self._settings = scenario, settings
        name = settings.generator
        found = find(GENERATOR, name, (BLOCKS,), "random.generator")
        assert found is not None  # blocks has been dealt with
        self._generator = make(GENERATOR, found, name, scenario, **settings.settings)

    def __call__(self, index: int, attempt: int) -> Scenario:
        """Layout ``index`` at its ``attempt``: a function of these and the scenario alone.

        Raises UserError for whatever is no scenario, or an impossible one.
        """
        name = self._settings.generator
        sequence = np.random.SeedSequence(self._settings.seed, spawn_key=(_STREAM, index, attempt))
        with calling(GENERATOR, name):
            layout = self._generator(index, np.random.Generator(np.random.PCG64(sequence)))
        if not isinstance(layout, Scenario):
            raise UserError(
                f"scenario generator {name}: layout {index} must be a Scenario, "
                f"not {type(layout).__name__}"
            )
        return self._checked(layout, index)

    def _checked(self, layout: Scenario, index: int) -> Scenario:
        """``layout`` as a geometry scenario, validated: a copy with changes has not been yet.

        Tasks and routes that it leaves out are left out.
        """
        data = layout.model_dump(warnings=False)  # validate() says what is wrong
        if layout.map is not None or layout.cells is not None:
            raise UserError(
                f"scenario generator {self._settings.generator}: layout {index} is a map; "
                "draw obstacles instead"
            )
        tasks, crowd = data["robot"], data["pedestrians"]
        routes = crowd.get("routes") if isinstance(crowd, dict) else None
        # Of kind geometry a scenario needs both; where they are to be found, others stand in.
        data["robot"] = tasks or [_NOWHERE]
        if isinstance(crowd, dict):
            data["pedestrians"] = {**crowd, "routes": routes or [_NOWHERE]}
        data |= {"kind": "geometry", "random": None, "name": f"{self._scenario.name}-{index}"}
        where = f"scenario generator {self._settings.generator}: layout {index}"
        checked = validate(Scenario, data, where)
        people = checked.pedestrians
        return checked.model_copy(
            update={
                "robot": checked.robot if tasks else [],
                "pedestrians": people if routes else people.model_copy(update={"routes": []}),
            }
        )
