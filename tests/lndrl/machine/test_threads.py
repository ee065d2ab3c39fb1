"""Threads of products."""

from __future__ import annotations

import torch

from lndrl.machine.threads import kept_threads, set_threads
from tests.lndrl.machine.blas import blas_threads


def test_numpy_and_torch_get_as_many_and_then_their_own_back() -> None:
    before = blas_threads(), torch.get_num_threads()
    with kept_threads():
        for count in (1, 2):
            set_threads(count)
            assert (blas_threads(), torch.get_num_threads()) == ({count}, count)
    assert (blas_threads(), torch.get_num_threads()) == before
