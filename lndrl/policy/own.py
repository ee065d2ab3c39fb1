"""Networks and encoders that are classes of a user's own, as the rest of the program needs them.

Around each stands a module of ours that calls it, says in one sentence what it does wrong, and
looks once, when it is made, whether its answers are what its place needs.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor, nn

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.extensions import ENCODER, NETWORK, Hook, calling, find, make
from lndrl.navigation.privileged.floats import NAMES
from lndrl.policy.inputs import Inputs

_ROWS = 2  # of the trial that a part is looked at with


class OwnNetwork(nn.Module):
    """``network.policy``: both the policy and, with one output, the value network.

    Its class is called with (config, outputs) and its settings; ``forward`` gets ``Inputs`` with
    dense maps and returns (N, outputs). Weights are initialized by itself. Raises UserError where
    it is not trusted, not there, or not what it should be.
    """

    def __init__(self, config: RunConfig, outputs: int) -> None:
        super().__init__()
        self.outputs = outputs
        self._name = config.network.policy
        settings = dict(config.network.policy_settings)
        self.network = _made(NETWORK, self._name, settings, "network.policy", config, outputs)
        known = outputs == 1 and config.learner.privileged_critic
        trial = trial_inputs(config, privileged=known)
        _look(NETWORK, self._name, self.network, lambda: self(trial))

    def forward(self, inputs: Inputs) -> Tensor:
        """Head outputs float32 (N, outputs) before any softmax."""
        if self.outputs != 1:  # what actors do not have must not decide in the learner either
            inputs = replace(inputs, privileged=None)
        with calling(NETWORK, self._name):
            answer = self.network(inputs)
        _check_shape(NETWORK, self._name, answer, (inputs.goal.shape[0], self.outputs))
        return answer.float()

    def freeze(self) -> None:
        """Nothing is kept of weights that change."""

    def coarse(self) -> OwnNetwork:
        """For products in bfloat16: autocast sees to them, the weights stay as they are."""
        return self


class OwnEncoder(nn.Module):
    """An encoder inside the built-in network; its class says how many ``features`` it gives.

    ``shape`` is that of one row of what it reads. Raises UserError as ``OwnNetwork`` does.
    """

    def __init__(
        self,
        config: RunConfig,
        name: str,
        settings: dict[str, Any],
        where: str,
        shape: tuple[int, ...],
    ) -> None:
        super().__init__()
        self._name = name
        self.encoder = _made(ENCODER, name, settings, where, config)
        features = getattr(self.encoder, "features", None)
        if type(features) is not int or features < 1:
            raise UserError(
                f"encoder {name}: its objects must say how many features they give, "
                f"e.g. self.features = 256, not {features!r}"
            )
        self.features = features
        _look(ENCODER, name, self.encoder, lambda: self(torch.zeros(_ROWS, *shape)))

    def forward(self, values: Tensor) -> Tensor:
        """(N, features)."""
        with calling(ENCODER, self._name):
            answer = self.encoder(values)
        _check_shape(ENCODER, self._name, answer, (values.shape[0], self.features))
        return answer


def trial_inputs(config: RunConfig, rows: int = _ROWS, privileged: bool = False) -> Inputs:
    """Inputs of ``rows`` empty observations, maps dense."""
    task = config.task
    side = task.map_cells
    return Inputs(
        scan=torch.zeros(rows, task.scan_frames * config.world.laser.beams),
        goal=torch.zeros(rows, 6),
        people=torch.zeros(rows, 3, side, side) if config.network.pedestrian_map else None,
        privileged=torch.zeros(rows, len(NAMES)) if privileged else None,
    )


def _made(hook: Hook, name: str, settings: dict[str, Any], where: str, *arguments: Any) -> Any:
    found = find(hook, name, where=where)
    assert found is not None  # built-in parts have been dealt with
    if not issubclass(found, nn.Module):
        raise UserError(f"{where}: {hook.what} {name}: must be a torch.nn.Module")
    return make(hook, found, name, *arguments, **settings)


def _look(hook: Hook, name: str, module: nn.Module, answer: Any) -> None:
    """Raise UserError unless the part answers, and always alike, and its weights can travel."""
    for key, tensor in module.state_dict().items():
        if tensor.dtype != torch.float32:
            raise UserError(
                f"{hook.what} {name}: {key} is {tensor.dtype}; only float32 weights travel "
                "between learner and actors (a batch norm also counts its batches: leave it out)"
            )
    if not any(parameter.requires_grad for parameter in module.parameters()):
        raise UserError(f"{hook.what} {name}: has no parameters to train")
    with torch.no_grad():
        first, second = answer(), answer()
    if not torch.isfinite(first).all():
        raise UserError(f"{hook.what} {name}: answers an empty observation with {_odd(first)}")
    if not torch.equal(first, second):
        raise UserError(
            f"{hook.what} {name}: answers the same input differently; leave out dropout and noise, "
            "actors and learner must compute the same"
        )


def _check_shape(hook: Hook, name: str, answer: Any, shape: tuple[int, ...]) -> None:
    if not isinstance(answer, Tensor) or not answer.is_floating_point():
        kind = answer.dtype if isinstance(answer, Tensor) else type(answer).__name__
        raise UserError(f"{hook.what} {name}: must answer with a tensor of floats, not {kind}")
    if tuple(answer.shape) != shape:
        raise UserError(
            f"{hook.what} {name}: answers with {list(answer.shape)} where {list(shape)} is needed"
        )


def _odd(values: Tensor) -> str:
    return f"{float(values[~torch.isfinite(values)][0])}"
