"""What only the critic may see of a chunk, written down beside what the policy sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation import StepResult, VectorNavigation


class Witness:
    """Records ``environment.privileged`` (B, K) over ``steps`` control steps, where there is any.

    Attributes:
        privileged: float32 (T, B, K), None where the environment writes none.
    """

    def __init__(self, environment: VectorNavigation, steps: int) -> None:
        self._environment = environment
        self.privileged: NDArray[np.float32] | None = None
        self._finals: list[NDArray[np.float32]] = []
        if environment.privileged is not None:
            self.privileged = np.zeros((steps, *environment.privileged.shape), np.float32)
            self._finals.append(environment.privileged[:0].copy())

    def see(self, t: int) -> None:
        """Keep what belongs to the observation before step ``t``."""
        if self.privileged is not None and self._environment.privileged is not None:
            self.privileged[t] = self._environment.privileged

    def follow(self, result: StepResult, needed: NDArray[np.bool_]) -> None:
        """Keep what belongs to the states that ``following`` gives for ``needed`` (B,)."""
        known, final = self._environment.privileged, result.final_privileged
        if known is not None and final is not None:
            self._finals.append(np.where(result.truncated[:, None], final, known)[needed])

    def finals(self) -> NDArray[np.float32] | None:
        """All that was followed, (F, K) in that order."""
        return np.concatenate(self._finals) if self._finals else None
