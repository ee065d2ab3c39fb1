"""Acting: from observations to actions and their log-probabilities."""

from __future__ import annotations

import importlib
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.kernels import expect
from lndrl.machine.threads import set_threads
from lndrl.navigation import Observation
from lndrl.navigation.pedestrian_map import collect_many
from lndrl.policy import sparse
from lndrl.policy.acting.network import ArrayNetwork, supports_arrays
from lndrl.policy.arrays import ArrayInputs, array_inputs, supports_sparse
from lndrl.policy.shapes import parameter_shapes
from lndrl.policy.weights import read_tensors

# torch is imported by those policies alone that need it.

CPU = "cpu"


class Policy(Protocol):
    """What evaluates a policy somewhere."""

    def load(self, blob: bytes) -> None:
        """Replace the weights; raises UserError when they are of another network."""

    def log_probabilities(self, observation: Observation) -> NDArray[np.float32]:
        """Log-probabilities (B, actions) for observations (B,)."""


class LocalPolicy(Policy, Protocol):
    """One that works on the CPU, where inputs can be prepared by others, too."""

    def answer(self, inputs: ArrayInputs) -> NDArray[np.float32]:
        """Log-probabilities (N, actions)."""


class ArrayPolicy:
    """Evaluates ``ArrayNetwork``; see ``supports_arrays``. Weights are zero until the first."""

    def __init__(self, config: RunConfig) -> None:
        self._config = config
        self._network = ArrayNetwork(config)

    def load(self, blob: bytes) -> None:
        """See ``PolicyRunner``."""
        tensors = read_tensors(blob, parameter_shapes(self._config), config=self._config)
        del self._network  # two at a time would be the most memory that an actor ever needs
        self._network = ArrayNetwork(self._config, tensors)

    def log_probabilities(self, observation: Observation) -> NDArray[np.float32]:
        """See ``PolicyRunner``."""
        return self.answer(array_inputs(observation, self._config))

    def answer(self, inputs: ArrayInputs) -> NDArray[np.float32]:
        """Log-probabilities (N, actions)."""
        logits = self._network(inputs)
        logits -= logits.max(axis=1, keepdims=True)
        logits -= np.log(np.exp(logits).sum(axis=1, keepdims=True))
        return logits


def local_policy(config: RunConfig, bfloat16: bool = False) -> LocalPolicy:
    """What evaluates ``config``'s policy on the CPU: without torch where that can be."""
    if supports_sparse(config):
        expect(collect_many, *sparse.KERNELS, *(sparse.COARSE_KERNELS if bfloat16 else ()))
    if supports_arrays(config) and not bfloat16:
        return ArrayPolicy(config)
    from lndrl.policy.acting.modules import ModulePolicy

    return ModulePolicy(config, bfloat16)


def act_on_one_thread(*configs: RunConfig) -> None:
    """Let the policies of ``configs`` take one thread each from now on.

    Processes that act share the cores by being many, and sums rounded alike need as many threads.
    """
    load_engine(*configs)
    set_threads(1)


def load_engine(*configs: RunConfig) -> None:
    """Import what the policies of ``configs`` are evaluated by, whose threads are then known."""
    if not all(supports_arrays(config) for config in configs):
        importlib.import_module("torch")


class PolicyRunner:
    """A policy without gradients; the weights can be replaced at any time between calls.

    Before the first ones they are of no meaning. ``device`` is cpu, cuda or cuda:N; on the CPU the
    evaluation is sparse where it can be, and needs no torch where all parts are built in.
    ``bfloat16`` does the products in bfloat16, which pays on processors that have instructions
    for it and costs about two decimal digits of the log-probabilities. Raises UserError when the
    device is not there.
    """

    def __init__(self, config: RunConfig, device: str = CPU, bfloat16: bool = False) -> None:
        self.config = config
        self.said = np.zeros((0, 0), np.float32)  # log-probabilities (B, A) of the last ``act``
        self.policy: Policy
        if device == CPU:
            self.policy = local_policy(config, bfloat16)
        else:
            from lndrl.policy.acting.remote import policy_on

            self.policy = policy_on(device, config, bfloat16)

    def load(self, blob: bytes) -> None:
        """Replace the weights; raises UserError when they are of another network."""
        self.policy.load(blob)

    def log_probabilities(self, observation: Observation) -> NDArray[np.float32]:
        """Log-probabilities (B, actions) for observations (B,)."""
        return self.policy.log_probabilities(observation)

    def act(
        self,
        observation: Observation,
        rng: np.random.Generator,
        greedy: bool = False,
        given: NDArray[np.integer] | None = None,
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Actions uint8 (B,) and their log-probabilities float32 (B,).

        Sampled by the Gumbel trick from ``rng``, or the most likely ones when ``greedy``. Where
        ``given`` (B,) is not negative, that action is taken whatever the policy says of it.
        """
        self.said = log_probabilities = self.log_probabilities(observation)
        noise = 0.0 if greedy else rng.gumbel(size=log_probabilities.shape)
        scores = log_probabilities + noise
        action = scores.argmax(axis=1)
        if given is not None:
            action = np.where(given >= 0, given, action)
        chosen = np.take_along_axis(log_probabilities, action[:, None], axis=1)[:, 0]
        if given is not None:  # as unlikely as a float32 can say, and an upload may hold
            chosen = chosen.clip(min=np.float32(-100.0))
        return action.astype(np.uint8), chosen
