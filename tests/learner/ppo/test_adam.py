"""Adam against torch's own."""

import torch

from learner.ppo.adam import Adam


def parameters(seed: int) -> list[torch.Tensor]:
    draw = torch.Generator().manual_seed(seed)
    shapes = ((7, 5), (3,), (2, 3, 4))
    return [torch.randn(shape, generator=draw).requires_grad_() for shape in shapes]


def gradients(seed: int) -> list[torch.Tensor]:
    return [3.0 * parameter.detach() for parameter in parameters(1000 + seed)]


def test_steps_are_those_of_torch() -> None:
    """With a rate that changes, gradients that are divided, and a parameter that has none."""
    ours, theirs = parameters(0), parameters(0)
    adam = Adam(ours, 1e-2, 1e-5)
    twin = torch.optim.Adam(theirs, lr=1e-2, eps=1e-5, fused=True)
    for number in range(20):
        adam.rate = twin.param_groups[0]["lr"] = 1e-2 / (1 + number)
        divisor = 1.0 + number % 3
        adam.forget_gradients()
        given = zip(ours, theirs, gradients(number), strict=True)
        for position, (one, other, gradient) in enumerate(given):
            if position != 1 or number > 4:
                one.grad, other.grad = gradient.clone(), gradient / divisor
        adam.step(torch.tensor(divisor))
        twin.step()
        for one, other in zip(ours, theirs, strict=True):
            torch.testing.assert_close(one, other, rtol=1e-6, atol=1e-7)
    for one, other in zip(ours, theirs, strict=True):
        assert adam.state[one].keys() == twin.state[other].keys()
        for name, value in twin.state[other].items():
            torch.testing.assert_close(adam.state[one][name], value, rtol=1e-5, atol=1e-7)
    assert [int(adam.state[one]["step"]) for one in ours] == [20, 15, 20]


def test_rate_is_what_it_was_set_to() -> None:
    adam = Adam(parameters(0), 1e-2, 1e-5)
    assert adam.rate == 1e-2
    adam.rate = 0.0
    before = [parameter.detach().clone() for parameter in adam.parameters]
    for parameter, gradient in zip(adam.parameters, gradients(0), strict=True):
        parameter.grad = gradient
    adam.step(torch.tensor(1.0))
    for parameter, old in zip(adam.parameters, before, strict=True):
        assert torch.equal(parameter, old)
