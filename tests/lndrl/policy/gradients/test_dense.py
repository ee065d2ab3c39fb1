"""Products by either library: the same numbers, gradients too, whatever the shapes."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from lndrl.policy.gradients import dense
from lndrl.policy.gradients.dense import _times, linear


@pytest.fixture(params=[False, True], autouse=True)
def onednn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Without oneDNN, and with it on any processor and for products of any size."""
    used = bool(request.param)
    monkeypatch.setattr(dense, "has_onednn", lambda: used)
    monkeypatch.setattr(dense, "_LEAST", 0)
    return used


@pytest.mark.parametrize(("rows", "inner", "columns"), [(1, 1, 1), (7, 33, 5), (64, 128, 256)])
@pytest.mark.parametrize("transposed", [False, True])
def test_products_are_products(rows: int, inner: int, columns: int, transposed: bool) -> None:
    torch.manual_seed(rows)
    a = torch.randn(inner, rows).t() if transposed else torch.randn(rows, inner)
    b = torch.randn(columns, inner).t() if transposed else torch.randn(inner, columns)
    exact = (a.double() @ b.double()).float()
    torch.testing.assert_close(_times(a, b), exact, rtol=1e-5, atol=1e-5)


def test_a_layer_and_its_gradients() -> None:
    torch.manual_seed(1)
    layer, x = nn.Linear(40, 24), torch.randn(9, 40, requires_grad=True)
    weights = torch.randn(9, 24)
    found = []
    for call in (layer, lambda x: linear(layer, x)):
        of = (layer.weight, layer.bias, x)
        found.append(torch.autograd.grad((call(x) * weights).sum(), of))
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-5)


def test_other_types_and_shapes_are_left_to_torch() -> None:
    layer = nn.Linear(8, 4)
    x = torch.randn(2, 3, 8)
    torch.testing.assert_close(linear(layer, x), layer(x))
    coarse = nn.Linear(8, 4).bfloat16()
    assert linear(coarse, torch.randn(3, 8).bfloat16()).dtype == torch.bfloat16


def test_small_products_are_not_worth_the_call(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dense, "_LEAST", 1000)
    asked: list[bool] = []

    def has_onednn() -> bool:
        asked.append(True)
        return False

    monkeypatch.setattr(dense, "has_onednn", has_onednn)
    _times(torch.ones(9, 10), torch.ones(10, 11))
    assert not asked
    _times(torch.ones(10, 10), torch.ones(10, 11))
    assert asked
