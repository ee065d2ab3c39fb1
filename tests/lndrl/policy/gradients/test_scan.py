"""The compiled scan convolutions against torch's."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional as F  # noqa: N812  (torch's own convention)

from lndrl.policy.gradients import scan_convolutions


@pytest.mark.parametrize(("beams", "strides"), [(720, (3, 2)), (107, (3, 2)), (64, (1, 1))])
def test_outputs_and_gradients_equal_torchs(beams: int, strides: tuple[int, int]) -> None:
    generator = torch.Generator().manual_seed(beams)
    scan = torch.rand(7, beams, generator=generator)
    shapes = ((32, 1, 5), (32,), (16, 32, 3), (16,))
    weights = [torch.randn(shape, generator=generator) * 0.3 for shape in shapes]
    results = []
    for compiled in (True, False):
        w1, b1, w2, b2 = parameters = [w.clone().requires_grad_() for w in weights]
        if compiled:
            out = scan_convolutions(scan, w1, b1, w2, b2, strides)
        else:
            hidden = F.relu(F.conv1d(scan.unsqueeze(1), w1, b1, stride=strides[0]))
            out = F.relu(F.conv1d(hidden, w2, b2, stride=strides[1])).flatten(1)
        upstream = torch.randn(out.shape, generator=torch.Generator().manual_seed(1))
        out.backward(upstream)
        gradients = [p.grad for p in parameters if p.grad is not None]
        assert len(gradients) == 4
        results.append([out.detach(), *gradients])
    assert len(results[0][0]) == 7 and (results[0][0] > 0).float().mean() > 0.2
    for compiled, reference in zip(*results, strict=True):
        torch.testing.assert_close(compiled, reference, rtol=1e-4, atol=1e-4)
