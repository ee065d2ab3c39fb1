"""A batch as the networks read it, on the CPU or on another device, and inputs made once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Future
from threading import Lock

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learner.ppo.batch import Batch
from lndrl.config import RunConfig
from lndrl.navigation import Observation, action_table
from lndrl.navigation.privileged.floats import NAMES
from lndrl.policy import CompactObservation, Inputs, prepare

Rows = slice | Tensor
MakeInputs = Callable[[Hashable, Rows], Inputs]

_COLUMNS: tuple[str, ...] = ("action", "log_prob", "proximal", "advantage", "target")
_SPARE = 1.25  # room beyond a batch that needed new memory


class Samples:
    """The batch of an update where the networks are.

    ``load`` brings a batch, ``set_goals`` what it is trained towards; rows are chosen by slices
    or by indices int64 on ``device``. This one leaves observations where they are, on the CPU.

    Attributes:
        action int64, log_prob, proximal, advantage, target float32: (N,) or longer; what stands
            beyond N is left from larger batches.
        teacher float16 (N, A), taught float32 (N,): as of Batch; empty in a run without a teacher.
    """

    def __init__(self, config: RunConfig) -> None:
        self.config = config
        self.device = torch.device("cpu")
        self.action = torch.empty(0, dtype=torch.int64)
        self.log_prob = self.proximal = self.advantage = self.target = torch.empty(0)
        self.teacher, self.taught = torch.empty(0, 0, dtype=torch.float16), torch.empty(0)

    def load(self, batch: Batch) -> bool:
        """Take ``batch`` over; it must stay as it is until the next.

        Returns whether memory on the device moved.
        """
        self._observation, self._final = batch.observation, batch.final_observation
        self._known, self._final_known = batch.privileged, batch.final_privileged
        self.action = torch.from_numpy(batch.action)
        self.log_prob = torch.from_numpy(batch.log_prob)
        if batch.teacher is not None and batch.taught is not None:
            self.teacher = torch.from_numpy(batch.teacher)
            self.taught = torch.from_numpy(batch.taught)
        return False

    def set_goals(
        self, proximal: Tensor, advantage: NDArray[np.float32], target: NDArray[np.float32]
    ) -> None:
        """Proximal log-probabilities, advantages and value targets of the batch, all (N,)."""
        self.proximal = proximal
        self.advantage, self.target = torch.from_numpy(advantage), torch.from_numpy(target)

    def inputs(self, key: Hashable, rows: Rows) -> Inputs:
        """Inputs of samples; ``key`` names ``rows`` to those who share inputs."""
        return self._prepare(self._observation, self._known, rows)

    def final_inputs(self, key: Hashable, rows: Rows) -> Inputs:
        """Inputs of the observations that only bootstrap."""
        return self._prepare(self._final, self._final_known, rows)

    def orders(self, orders: list[NDArray[np.int64]]) -> list[Tensor]:
        """Permutations of the rows, on ``device``."""
        return list(torch.from_numpy(np.stack(orders)).to(self.device, non_blocking=True))

    def _prepare(
        self, observation: Observation, known: NDArray[np.float32] | None, rows: Rows
    ) -> Inputs:
        index = rows if isinstance(rows, slice) else rows.numpy()
        return prepare(
            observation.take(index), self.config, None if known is None else known[index]
        )


class DeviceSamples(Samples):
    """The batch uploaded once, in its compact form; minibatches are made on the device.

    Memory keeps its addresses from batch to batch, as CUDA graphs need it, until a larger batch
    comes.
    """

    def __init__(self, config: RunConfig, device: torch.device) -> None:
        super().__init__(config)
        self.device = device
        self._rows = CompactObservation.view(Observation.zeros_for(0, config)).to(device)
        self._finals = self._rows
        self._columns = _COLUMNS
        if config.ppo.teacher is not None:
            self._columns += ("teacher", "taught")
            self.teacher = torch.empty(0, len(action_table(config.task)), dtype=torch.float16)
        self.privileged = torch.empty(0, len(NAMES), device=device)
        if config.learner.privileged_critic:
            self._columns += ("privileged",)
        for name in self._columns:
            setattr(self, name, getattr(self, name).to(device))
        self.final_privileged = self.privileged

    def load(self, batch: Batch) -> bool:
        """Upload ``batch``, from pinned memory without waiting; whether memory moved."""
        moved = len(batch) > len(self.action)
        if moved:
            capacity = len(batch) if not len(self.action) else int(_SPARE * len(batch))
            self._rows = _room(self._rows, capacity)
            for name in self._columns:
                column = getattr(self, name)
                setattr(self, name, column.new_zeros(capacity, *column.shape[1:]))
        if len(batch.final_observation) > len(self._finals.goal):
            room = int(_SPARE * len(batch.final_observation)) + 1
            self._finals = _room(self._finals, room)
            self.final_privileged = self.privileged.new_zeros(room, len(NAMES))
        self._rows.copy_(CompactObservation.view(batch.observation))
        self._finals.copy_(CompactObservation.view(batch.final_observation))
        self._upload("action", torch.from_numpy(batch.action))
        self._upload("log_prob", torch.from_numpy(batch.log_prob))
        if batch.teacher is not None and batch.taught is not None:
            self._upload("teacher", torch.from_numpy(batch.teacher))
            self._upload("taught", torch.from_numpy(batch.taught))
        if batch.privileged is not None and batch.final_privileged is not None:
            self._upload("privileged", torch.from_numpy(batch.privileged))
            self._upload("final_privileged", torch.from_numpy(batch.final_privileged))
        return moved

    def set_goals(
        self, proximal: Tensor, advantage: NDArray[np.float32], target: NDArray[np.float32]
    ) -> None:
        """As of Samples."""
        self._upload("proximal", proximal)
        self._upload("advantage", torch.from_numpy(advantage))
        self._upload("target", torch.from_numpy(target))

    def inputs(self, key: Hashable, rows: Rows) -> Inputs:
        """As of Samples; ``key`` is not needed, nothing is shared between streams."""
        return self._expanded(self._rows, self.privileged, rows)

    def final_inputs(self, key: Hashable, rows: Rows) -> Inputs:
        """As of Samples."""
        return self._expanded(self._finals, self.final_privileged, rows)

    def _expanded(self, compact: CompactObservation, known: Tensor, rows: Rows) -> Inputs:
        drawn = compact.take(rows).expand(self.config.task)
        if not self.config.learner.privileged_critic:
            return Inputs(*drawn)
        return Inputs(
            *drawn, known[rows] if isinstance(rows, slice) else known.index_select(0, rows)
        )

    def _upload(self, name: str, column: Tensor) -> None:
        getattr(self, name)[: len(column)].copy_(column, non_blocking=True)


class SharedInputs:
    """Inputs that both networks read, made by whichever comes first and dropped by the second.

    Neither waits for the other but for inputs that are being made at that moment.
    """

    def __init__(self, make: MakeInputs, readers: int) -> None:
        self._make = make
        self._readers = readers
        self._made: dict[Hashable, Future[Inputs]] = {}
        self._lock = Lock()

    def get(self, key: Hashable, rows: Rows) -> Inputs:
        """Inputs of ``rows``; every reader must give the same ``rows`` with the same ``key``."""
        with self._lock:
            future = self._made.pop(key, None)
            first = future is None
            if future is None:
                future = Future()
                if self._readers > 1:
                    self._made[key] = future
        if first:
            try:
                future.set_result(self._make(key, rows))
            except BaseException as error:
                future.set_exception(error)
        return future.result()

    def leave(self) -> None:
        """One reader less: from now on nothing is kept for it."""
        with self._lock:
            self._readers -= 1


def _room(like: CompactObservation, capacity: int) -> CompactObservation:
    return CompactObservation(
        *(
            getattr(like, name).new_zeros((capacity, *getattr(like, name).shape[1:]))
            for name in ("scan", "people", "count", "goal")
        )
    )
