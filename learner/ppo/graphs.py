"""A gradient step that becomes one CUDA graph: one launch instead of some hundred."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

from lndrl.policy import EAGER_RUNS, Record

_MOST_GRAPHS = 4  # each keeps its activations; rarer minibatch sizes run eagerly


class GraphedStep:
    """``step(rows)`` that is recorded once per number of rows, and replayed from then on.

    ``step`` must neither wait for the device nor keep count on the host, and all memory that it
    reads besides ``rows`` must stay where it is; call ``forget`` when it moves.
    """

    def __init__(self, step: Callable[[Tensor], None], record: Record) -> None:
        self._step = step
        self._record = record
        self.forget()

    def forget(self) -> None:
        """Drop all graphs."""
        self._runs: dict[int, int] = {}
        self._graphs: dict[int, tuple[Tensor, Callable[[], None]]] = {}

    def __call__(self, rows: Tensor) -> None:
        """One step on ``rows``, indices int64 on the device."""
        count = len(rows)
        if count not in self._graphs:
            self._runs[count] = self._runs.get(count, 0) + 1
            if self._runs[count] <= EAGER_RUNS or len(self._graphs) >= _MOST_GRAPHS:
                self._step(rows)
                return
            kept = rows.clone()
            self._graphs[count] = kept, self._record(lambda: self._step(kept))
        kept, replay = self._graphs[count]
        kept.copy_(rows)
        replay()
