"""Work on a GPU that is recorded once as a CUDA graph and launched as one piece."""

from __future__ import annotations

from collections.abc import Callable

import torch

Record = Callable[[Callable[[], None]], Callable[[], None]]
"""Records work without doing it; the result does the work on the same memory."""

EAGER_RUNS = 3
"""Runs before work is recorded: libraries choose their algorithms, optimizers their memory."""


def record_cuda_graph(stream: torch.cuda.Stream, work: Callable[[], None]) -> Callable[[], None]:
    """Record ``work`` on ``stream`` as a CUDA graph; returns its replay on the current stream."""
    graph = torch.cuda.CUDAGraph()
    # Other threads may use the driver meanwhile; only this one is being recorded.
    with torch.cuda.graph(graph, stream=stream, capture_error_mode="thread_local"):
        work()
    return graph.replay
