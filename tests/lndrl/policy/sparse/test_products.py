"""Products by either library: the same numbers, gradients too, whatever the shapes."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from lndrl.policy.sparse import products
from lndrl.policy.sparse.products import gradient_part, linear, times, times_part


@pytest.fixture(params=[False, True], autouse=True)
def onednn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Without oneDNN, and with it on any processor and for products of any size."""
    used = bool(request.param)
    monkeypatch.setattr(products, "has_onednn", lambda: used)
    monkeypatch.setattr(products, "_LEAST", 0)
    return used


@pytest.mark.parametrize(("rows", "inner", "columns"), [(1, 1, 1), (7, 33, 5), (64, 128, 256)])
@pytest.mark.parametrize("transposed", [False, True])
def test_products_are_products(rows: int, inner: int, columns: int, transposed: bool) -> None:
    torch.manual_seed(rows)
    a = torch.randn(inner, rows).t() if transposed else torch.randn(rows, inner)
    b = torch.randn(columns, inner).t() if transposed else torch.randn(inner, columns)
    exact = (a.double() @ b.double()).float()
    torch.testing.assert_close(times(a, b), exact, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("part", [(0, 1), (0, 16), (3, 20), (30, 40), (39, 40), (0, 40)])
def test_products_of_a_part_are_of_that_part_alone(part: tuple[int, int]) -> None:
    """Neighbours may be multiplied, too: nothing of it shows."""
    torch.manual_seed(2)
    rows, gradient, weight = torch.randn(40, 24), torch.randn(40, 9), torch.randn(24, 9)
    chosen = slice(*part)
    out = torch.full((40, 9), 7.0)
    times_part(rows, chosen, weight, out)
    torch.testing.assert_close(out[chosen], rows[chosen] @ weight, rtol=1e-5, atol=1e-5)
    assert (out[: part[0]] == 7.0).all() and (out[part[1] :] == 7.0).all()
    found = torch.empty(24, 9)
    gradient_part(rows, gradient, chosen, found)
    exact = rows[chosen].t() @ gradient[chosen]
    torch.testing.assert_close(found, exact, rtol=1e-5, atol=1e-5)


def test_sizes_are_few() -> None:
    """Each would be compiled, and a thousand are kept."""
    taken = [products._rounded(slice(5, 5 + n), 1000)[0] for n in range(1, 321)]
    assert len({each.stop - each.start for each in taken}) == 20


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
    monkeypatch.setattr(products, "_LEAST", 1000)
    asked: list[bool] = []

    def has_onednn() -> bool:
        asked.append(True)
        return False

    monkeypatch.setattr(products, "has_onednn", has_onednn)
    times(torch.ones(9, 10), torch.ones(10, 11))
    assert not asked
    times(torch.ones(10, 10), torch.ones(10, 11))
    assert asked
