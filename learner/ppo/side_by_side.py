"""Work of both networks at the same time: a thread each on the CPU, a stream each on a GPU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

import torch

from learner.ppo.trainee import Trainee
from lndrl.machine.threads import set_numpy_threads

R = TypeVar("R")


class SideBySide:
    """Threads of ``trainees``, always the same for each; ``threads`` is how many torch takes there.

    A GPU (``on_device``) is fed by the thread that calls.
    """

    def __init__(self, trainees: dict[str, Trainee], threads: int, on_device: bool = False) -> None:
        self.threads = threads
        self._on_device = on_device
        set_numpy_threads(1)  # it multiplies small parts, many, for both networks at once
        # Always the same thread for a network: a thread's allocator fits what it did before.
        self._pools = {
            trainee: ThreadPoolExecutor(1, name, initializer=self._limit_threads)
            for name, trainee in trainees.items()
        }

    def each(self, *work: tuple[Trainee, Callable[[], R]]) -> list[R]:
        """Do each network's work, at the same time; all of it has ended or is in order."""
        if not self._on_device:
            futures = [self._pools[trainee].submit(call) for trainee, call in work]
            wait(futures)
            return [future.result() for future in futures]
        trainees = [trainee for trainee, _ in work]
        wait_for_all(trainees)
        results = []
        for trainee, call in work:
            with trainee.on_stream():
                results.append(call())
        join_all(trainees)
        return results

    def each_thread(self, work: Callable[[], None]) -> None:
        """Call ``work`` in each thread that trains a network on the CPU; all have ended then."""
        futures = [pool.submit(work) for pool in self._pools.values()]
        wait(futures)
        for future in futures:
            future.result()

    def close(self) -> None:
        """End the threads."""
        for pool in self._pools.values():
            pool.shutdown(wait=True, cancel_futures=True)

    def _limit_threads(self) -> None:
        # torch's thread count belongs to the calling thread.
        torch.set_num_threads(self.threads)


def wait_for_all(trainees: Sequence[Trainee]) -> None:
    """Let the streams of ``trainees`` see what the current stream has done."""
    for trainee in trainees:
        trainee.wait()


def join_all(trainees: Sequence[Trainee]) -> None:
    """Let the current stream see what the streams of ``trainees`` have done."""
    for trainee in trainees:
        trainee.join()
