"""Memory for batches: taken once, used again for every update."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from lndrl.navigation import Observation, Trajectory

_SPARE = 1.25  # larger batches come in small steps; not each should cost new memory


class RolloutStore:
    """Arrays of one batch of samples and of the observations that only bootstrap.

    Grows when a larger batch comes and never shrinks. ``pinned`` memory can be copied to a GPU
    without waiting. ``fill`` overwrites what it returned before.
    """

    def __init__(self, pinned: bool = False) -> None:
        self._pinned = pinned
        self._observation: Observation | None = None
        self._final: Observation | None = None
        self._action = np.empty(0, np.int64)
        self._log_prob = np.empty(0, np.float32)
        self._version = np.empty(0, np.int64)
        self._teacher = np.empty((0, 0), np.float16)
        self._taught = np.empty(0, np.float32)
        self._privileged, self._final_privileged = np.empty((2, 0, 0), np.float32)

    def fill(self, trajectories: Sequence[Trajectory]) -> tuple[Any, ...]:
        """Copy at least one trajectory in, chunk by chunk, each flattened as t * B + b.

        Returns views: observation (N), final observation (F), action int64 (N,), log_prob
        float32 (N,), version int64 (N,), and in a run with a teacher its costs float16 (N, A) and
        where it was asked float32 (N,), else None twice; with a privileged critic what it sees of
        samples float32 (N, K) and finals (F, K), else None twice.
        """
        samples = sum(t.action.size for t in trajectories)
        finals = sum(len(t.final_index) for t in trajectories)
        self._observation = self._room(self._observation, samples, trajectories[0].observation)
        self._final = self._room(self._final, finals, trajectories[0].final_observation)
        if samples > len(self._action):
            capacity = len(self._observation)
            self._action = self._array((capacity,), np.int64)
            self._log_prob = self._array((capacity,), np.float32)
            self._version = self._array((capacity,), np.int64)
        sample = final = 0
        for trajectory in trajectories:
            rows = slice(sample, sample + trajectory.action.size)
            self._observation.put(rows, trajectory.observation.flatten())
            self._action[rows] = trajectory.action.reshape(-1)
            self._log_prob[rows] = trajectory.log_prob.reshape(-1)
            self._version[rows] = trajectory.version.reshape(-1)
            ends = slice(final, final + len(trajectory.final_index))
            self._final.put(ends, trajectory.final_observation)
            sample, final = rows.stop, ends.stop
        teacher = trajectories[0].teacher
        if teacher is not None:
            self._fill_taught(trajectories, teacher.shape[-1])
        return (
            self._observation.take(slice(samples)),
            self._final.take(slice(finals)),
            self._action[:samples],
            self._log_prob[:samples],
            self._version[:samples],
            None if teacher is None else self._teacher[:samples],
            None if teacher is None else self._taught[:samples],
            *self._fill_privileged(trajectories, samples, finals),
        )

    def _fill_privileged(
        self, trajectories: Sequence[Trajectory], samples: int, finals: int
    ) -> tuple[NDArray[Any] | None, NDArray[Any] | None]:
        """Copy in what only the critic sees of samples and finals, where the run has it."""
        known = [t.privileged for t in trajectories if t.privileged is not None]
        of_finals = [t.final_privileged for t in trajectories if t.final_privileged is not None]
        if not known:
            return None, None
        assert self._observation is not None and self._final is not None
        width = known[0].shape[-1]
        if self._privileged.shape != (len(self._observation), width):
            self._privileged = self._array((len(self._observation), width), np.float32)
        if self._final_privileged.shape != (len(self._final), width):
            self._final_privileged = self._array((len(self._final), width), np.float32)
        rows, ends = self._privileged[:samples], self._final_privileged[:finals]
        np.concatenate([each.reshape(-1, width) for each in known], out=rows)
        np.concatenate(of_finals, out=ends)
        return rows, ends

    def _fill_taught(self, trajectories: Sequence[Trajectory], actions: int) -> None:
        """Copy in what the teacher said; zeros, marked so, where it was not asked."""
        capacity = len(self._action)
        if self._teacher.shape != (capacity, actions):
            self._teacher = self._array((capacity, actions), np.float16)
            self._taught = self._array((capacity,), np.float32)
        first = 0
        for trajectory in trajectories:
            rows = slice(first, first + trajectory.action.size)
            labels = trajectory.teacher
            if labels is not None and len(labels):
                self._teacher[rows] = labels.reshape(-1, actions)
                self._taught[rows] = 1.0
            else:
                self._teacher[rows] = 0.0
                self._taught[rows] = 0.0
            first = rows.stop

    def _room(self, kept: Observation | None, rows: int, like: Observation) -> Observation:
        if kept is not None and rows <= len(kept):
            return kept
        capacity = math.ceil(rows * (1.0 if kept is None else _SPARE))
        return Observation(
            self._array((capacity, *like.scan.shape[-1:]), np.uint16),
            self._array((capacity, *like.pedestrians.shape[-2:]), np.float32),
            self._array((capacity,), np.uint8),
            self._array((capacity, *like.goal.shape[-1:]), np.float32),
        )

    def _array(self, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        size = math.prod(shape) * np.dtype(dtype).itemsize
        memory = torch.empty(size, dtype=torch.uint8, pin_memory=self._pinned)
        return memory.numpy().view(dtype).reshape(shape)
