"""One PPO update: both networks trained side by side on one batch.

Policy and value network share nothing but what they read, so they are trained at the same time.
On the CPU each has a thread: two matrix products at a time keep two cores busier than one product
that is split over both. A GPU is fed by one thread and has a stream for each network.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learner.ppo.average import Average
from learner.ppo.batch import Batch, batch_advantages, way_value
from learner.ppo.example.lessons import Lessons
from learner.ppo.example.stage import Stage
from learner.ppo.losses import (
    dangerous_share,
    expected_regret,
    explained_variance,
    policy_loss,
    teacher_divergence,
    value_loss,
)
from learner.ppo.safeguard import Safeguard
from learner.ppo.samples import DeviceSamples, Samples, SharedInputs
from learner.ppo.schedules import entropy_weight
from learner.ppo.side_by_side import SideBySide, join_all, wait_for_all
from learner.ppo.team import Channel, Team
from learner.ppo.trainee import DivergedError, Loss, Trainee, minibatches
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.machine.cores import usable_threads
from lndrl.policy import (
    Network,
    build_policy,
    build_value,
    resolve_device,
    supports_sparse,
)
from lndrl.transport.status import IMITATION

__all__ = ["PPO", "DivergedError"]

_POLICY_FIGURES = ("policy_loss", "entropy", "kl", "clip_fraction", "importance_max")
_TEACHER_FIGURES = ("teacher_kl", "teacher_agreement")
_FORWARD_ROWS = 256  # rows per pass without gradients: fits the caches, bounds the memory
_FORWARD_ROWS_GPU = 2048


class PPO:
    """Networks, optimizers and the update rule.

    Args:
        config: the run; ``learner`` says where and how precisely the networks are evaluated.
        dense: train on the CPU the way a GPU does, dense and in one thread; for tests.
        team: the ranks that train the same networks; all of them must make theirs at this moment.

    Attributes:
        policy, value: the two networks.
        average: the policy's averaged weights; None where ``learner.average`` is 0.
        policy_optimizer, value_optimizer: Adam, one each.
        rng: order of the minibatches; part of a checkpoint.
        device, precision: where the networks are, and the dtype of their products.

    Raises UserError when the device is not there, and for a teacher that cannot teach the task.
    """

    def __init__(self, config: RunConfig, dense: bool = False, team: Team | None = None) -> None:
        if misfit := config.teacher_misfit():
            raise UserError(misfit)
        self.config = config
        self.device = _device_of(team, resolve_device(config.learner.device))
        self.precision = _precision(config.learner.precision, self.device)
        self._on_device = dense or self.device.type != "cpu"
        torch.manual_seed(config.seed)
        self.policy = self._placed(build_policy(config))
        self.value = self._placed(build_value(config))
        decay = config.learner.average
        self.average = Average(self.policy, decay) if decay else None
        taught = config.ppo.teacher is not None
        self._figures = _POLICY_FIGURES + (_TEACHER_FIGURES if taught else ())
        self._stage = Stage()
        self._hold = torch.zeros(2, device=self.device)  # temperature and KL weight, see Stage
        self.lessons = Lessons(config) if taught else None
        self._per_metre = way_value(config)
        one, other = (None, None) if team is None else team.channels(self.device)
        self._actor = self._trainee(
            self.policy, config.ppo.actor_learning_rate, self._policy_loss, self._figures, one
        )
        self._critic = self._trainee(
            self.value, config.ppo.critic_learning_rate, self._value_loss, (), other
        )
        self._safeguard = Safeguard((self._actor, self._critic))
        self.policy_optimizer = self._actor.optimizer
        self.value_optimizer = self._critic.optimizer
        self.samples, self._lesson = (
            DeviceSamples(config, self.device) if self._on_device else Samples(config)
            for _ in range(2)
        )
        # Recorded CUDA graphs read what changes from memory, as they do Adam's rate.
        self._entropy: float | Tensor = config.ppo.entropy
        if self._on_device and config.ppo.entropy_final is not None:
            self._entropy = torch.tensor(config.ppo.entropy, device=self.device)
        self.rng = np.random.default_rng([config.seed, 0x9E3779B9])
        cores = config.learner.threads or usable_threads()
        sharing = 1 if team is None else team.neighbours
        self.work = SideBySide(
            {"policy": self._actor, "value": self._critic},
            max(1, cores // (2 * sharing)),
            self._on_device,
        )

    def close(self) -> None:
        """End the threads."""
        self.work.close()

    def update(
        self,
        batch: Batch,
        progress: float,
        stage: Stage = Stage(),  # noqa: B008  (frozen)
    ) -> dict[str, float]:
        """Train on ``batch``; ``progress`` in [0, 1] drives the learning-rate schedule.

        ``stage`` says what the policy learns from: the teacher of the run, reward, or both. The
        value network always learns from reward. Returns the figures of the update by name. Raises
        DivergedError where a loss, gradient, weight or moment is not finite; networks, optimizers
        and ``rng`` are then as before, but for what ``Safeguard`` rounds.
        """
        order = self.rng.bit_generator.state
        self._enter(stage)
        self._safeguard.keep()
        try:
            figures = self._update(batch, progress)
            if not self._safeguard.is_finite():
                raise DivergedError("weights or moments are no numbers any more")
        except DivergedError:
            if self.device.type == "cuda":
                torch.cuda.synchronize(self.device)  # the other network may be at work yet
            self._safeguard.restore()
            self.rng.bit_generator.state = order
            raise
        if self.average is not None:
            self.average.add(self.policy)
        return figures

    @property
    def acting(self) -> Network:
        """The policy that actors act on."""
        if self.average is not None and self.config.learner.acting == "average":
            return self.average.network
        return self.policy

    @property
    def tested(self) -> Network:
        """The policy that a checkpoint offers to whoever tests it."""
        return self.policy if self.average is None else self.average.network

    def is_finite(self) -> bool:
        """Whether all weights and moments are numbers."""
        return self._safeguard.is_finite()

    def _update(self, batch: Batch, progress: float) -> dict[str, float]:
        ppo = self.config.ppo
        scale = 1.0 - progress if ppo.learning_rate_schedule == "linear" else 1.0
        self.policy_optimizer.rate = scale * ppo.actor_learning_rate
        self.value_optimizer.rate = scale * ppo.critic_learning_rate
        self._set_entropy(entropy_weight(ppo, progress))
        self._load(batch)
        if self.lessons is not None and self._stage.phase == IMITATION:
            return self._imitate(batch, self.lessons)
        proximal, value, final_value = self._forward(batch)
        advantage, target = batch_advantages(batch, value, final_value, ppo, self._per_metre)
        variance = explained_variance(torch.from_numpy(value), torch.from_numpy(target))
        if ppo.normalize_advantages:
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        figures = self._train(len(batch), proximal, advantage, target)
        figures["explained_variance"] = variance
        figures["learning_rate"] = scale * ppo.actor_learning_rate
        if ppo.entropy_final is not None:
            figures["entropy_weight"] = entropy_weight(ppo, progress)
        return figures

    def _enter(self, stage: Stage) -> None:
        """Let losses be those of ``stage`` from now on."""
        if stage.phase != self._stage.phase:
            self._actor.memory_moved()  # a recorded step holds the loss of before
            if stage.phase != IMITATION and self.lessons is not None:
                self.lessons.forget()
        self._stage = stage
        self._hold.copy_(torch.tensor([stage.temperature, stage.kl]))

    def _imitate(self, batch: Batch, lessons: Lessons) -> dict[str, float]:
        """Train the policy on what it has met so far, the value network on ``batch`` (loaded)."""
        ppo, plan = self.config.ppo, self.config.imitation
        rate = self._stage.learning_rate or plan.learning_rate
        self.policy_optimizer.rate = rate
        lessons.add(batch)
        _, value, final_value = self._forward(batch)
        _, target = batch_advantages(batch, value, final_value, ppo, self._per_metre)
        variance = explained_variance(torch.from_numpy(value), torch.from_numpy(target))
        self.samples.set_goals(torch.zeros(len(batch)), np.zeros_like(target), target)
        self._actor.begin(self._lesson.inputs)
        work: list[tuple[Trainee, Samples, list[NDArray[np.int64]]]] = []
        # After a step back in a run, chunks may come first that nobody has labelled.
        if len(lessons):
            lesson = lessons.draw(max(1, round(plan.passes * len(batch))), self.rng)
            if self._lesson.load(lesson):
                self._actor.memory_moved()
            work = [(self._actor, self._lesson, [np.arange(len(lesson))])]
        order = [self.rng.permutation(len(batch)) for _ in range(ppo.epochs)]
        work.append((self._critic, self.samples, order))
        calls = []
        for trainee, samples, orders in work:
            inputs = SharedInputs(samples.inputs, readers=1)
            trainee.begin(inputs.get)
            calls.append((trainee, partial(self._alone, trainee, samples.orders(orders), inputs)))
        if self._on_device or ppo.joint_gradient_norm:
            for trainee, call in calls:
                trainee.wait()
                call()
                trainee.join()
        else:
            self.work.each(*calls)
        figures = self._after_epochs()
        figures["explained_variance"] = variance
        figures["learning_rate"] = rate
        return figures

    def train(
        self,
        batch: Batch,
        proximal: NDArray[np.float32],
        advantage: NDArray[np.float32],
        target: NDArray[np.float32],
    ) -> dict[str, float]:
        """All epochs over ``batch``: proximal log-probabilities, advantages, targets are (N,).

        Returns the means of the figures over the gradient steps. Raises DivergedError.
        """
        self._load(batch)
        return self._train(len(batch), torch.from_numpy(proximal), advantage, target)

    def each_thread(self, work: Callable[[], None]) -> None:
        """Call ``work`` in each thread that trains a network on the CPU; all have ended then."""
        self.work.each_thread(work)

    # -- the two phases of an update ---------------------------------------------------------

    def _forward(self, batch: Batch) -> tuple[Tensor, NDArray[np.float32], NDArray[np.float32]]:
        """Proximal log-probabilities (N,), on the device; values (N,) and final values (F,)."""
        size = _FORWARD_ROWS_GPU if self._on_device else _FORWARD_ROWS
        count, finals = len(batch), len(batch.final_observation)
        inputs = self._shared()

        def proximal() -> Tensor:
            logits = self._actor.outputs(inputs.get, count, size)
            action = self.samples.action[:count].unsqueeze(1)
            return torch.log_softmax(logits, dim=1).gather(1, action).squeeze(1)

        def values() -> Tensor:
            value = self._critic.outputs(inputs.get, count, size)
            final = self._critic.outputs(self.samples.final_inputs, finals, size)
            return torch.cat((value, final)).squeeze(1)

        log_prob, both = self.work.each((self._actor, proximal), (self._critic, values))
        value = both.cpu().numpy()
        return log_prob, value[:count], value[count:]

    def _train(
        self,
        count: int,
        proximal: Tensor,
        advantage: NDArray[np.float32],
        target: NDArray[np.float32],
    ) -> dict[str, float]:
        self.samples.set_goals(proximal, advantage, target)
        orders = self.samples.orders(
            [self.rng.permutation(count) for _ in range(self.config.ppo.epochs)]
        )
        both = (self._actor, self._critic)
        inputs = self._shared()
        for trainee in both:
            trainee.begin(inputs.get)
        if self._on_device or self.config.ppo.joint_gradient_norm:
            wait_for_all(both)
            self._epochs(list(both), orders)
            join_all(both)
        else:
            self.work.each(*((t, partial(self._alone, t, orders, inputs)) for t in both))
        return self._after_epochs()

    def _after_epochs(self) -> dict[str, float]:
        """Free what the steps needed; their figures."""
        both = (self._actor, self._critic)
        if not self._on_device:  # there torch has allocators of its own
            self.work.each(*((t, t.end) for t in both))
        policy, value = (trainee.figures() for trainee in both)
        return {
            **{name: policy[name] for name in self._figures if policy},
            **({"gradient_norm_policy": policy["gradient_norm"]} if policy else {}),
            "value_loss": value["loss"],
            "gradient_norm_value": value["gradient_norm"],
        }

    def _epochs(self, trainees: list[Trainee], orders: list[Tensor]) -> None:
        """All epochs of ``trainees``, in step with one another; the policy may end early."""
        ppo = self.config.ppo
        going = list(trainees)
        for epoch, order in enumerate(orders):
            parts = list(minibatches(order, ppo.minibatch_size))
            for number, rows in enumerate(parts):
                self._step(going, (epoch, number), rows)
            means = {trainee: trainee.end_epoch(len(parts)) for trainee in going}
            if self._actor in means and means[self._actor]["kl"] > (ppo.target_kl or np.inf):
                going = [] if ppo.joint_gradient_norm else [t for t in going if t != self._actor]
            if not going:
                break

    def _alone(self, trainee: Trainee, orders: list[Tensor], inputs: SharedInputs) -> None:
        try:
            self._epochs([trainee], orders)
        finally:
            inputs.leave()

    def _step(self, going: list[Trainee], key: tuple[int, int], rows: Tensor) -> None:
        if not self.config.ppo.joint_gradient_norm:
            for trainee in going:
                with trainee.on_stream():
                    trainee.step(key, rows)
            return
        # As published by the group: one gradient norm over both networks.
        self.work.each(*((t, partial(t.gradient, key, rows)) for t in going))
        norm = torch.linalg.vector_norm(torch.stack([t.norm() for t in going]))
        self.work.each(*((t, partial(t.apply, norm)) for t in going))

    # -- losses ------------------------------------------------------------------------------

    def _policy_loss(self, logits: Tensor, rows: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
        ppo, samples = self.config.ppo, self.samples
        temperature, weight = self._hold
        if self._stage.phase == IMITATION:
            cost = self._lesson.teacher.index_select(0, rows)
            divergence, agrees = teacher_divergence(logits, cost, temperature)
            log_probabilities = torch.log_softmax(logits.detach(), dim=1)
            entropy = -(log_probabilities.exp() * log_probabilities).sum(1).mean()
            total, none = divergence.mean(), torch.zeros((), device=logits.device)
            found = (total.detach(), entropy, none, none, none + 1.0)
            if self.config.imitation.regret > 0.0:
                total = total + self.config.imitation.regret * expected_regret(logits, cost).mean()
            return total, (*found, divergence.mean().detach(), agrees.mean())
        loss = policy_loss(
            logits,
            samples.action.index_select(0, rows),
            samples.log_prob.index_select(0, rows),
            samples.proximal.index_select(0, rows),
            samples.advantage.index_select(0, rows),
            ppo.clip,
            ppo.dual_clip,
            self._entropy,
            ppo.max_importance,
        )
        figures = (loss.policy, loss.entropy, loss.kl, loss.clip_fraction, loss.importance_max)
        if self.lessons is None:
            return loss.total, figures
        taught = samples.taught.index_select(0, rows)
        cost = samples.teacher.index_select(0, rows)
        divergence, agrees = teacher_divergence(logits, cost, temperature)
        # Of what the teacher was asked about; that may be none of it.
        share = taught.sum().clamp(min=1.0)
        held, agreement = (divergence * taught).sum() / share, (agrees * taught).sum() / share
        total = loss.total + weight * held
        plan = self.config.imitation
        if plan.avoid > 0.0:
            risk = (dangerous_share(logits, cost, plan.danger) * taught).sum() / share
            total = total + plan.avoid * risk
        return total, (*figures, held.detach(), agreement)

    def _value_loss(self, value: Tensor, rows: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
        target = self.samples.target.index_select(0, rows)
        return value_loss(value.squeeze(1), target, self.config.ppo.value_loss), ()

    # -- small steps -------------------------------------------------------------------------

    def _placed(self, network: Network) -> Network:
        network = network.to(self.device)
        if self._on_device or not supports_sparse(self.config):
            # Where dense convolutions run, this layout is the faster one.
            network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        return network

    def _trainee(
        self,
        network: Network,
        rate: float,
        loss: Loss,
        names: tuple[str, ...],
        channel: Channel | None,
    ) -> Trainee:
        # One gradient norm over both networks makes each wait for the other anyway.
        alone = self.device.type == "cuda" and not self.config.ppo.joint_gradient_norm
        stream = torch.cuda.Stream(self.device) if alone else None
        graphs = self.config.learner.cuda_graphs and channel is None  # sums are not recorded
        return Trainee(
            *(network, rate, loss, names, self.config.ppo),
            *(self.precision, stream, graphs, channel),
        )

    def _set_entropy(self, weight: float) -> None:
        if isinstance(self._entropy, Tensor):
            self._entropy.fill_(weight)
        else:
            self._entropy = weight

    def _load(self, batch: Batch) -> None:
        if self.samples.load(batch):
            for trainee in (self._actor, self._critic):
                trainee.memory_moved()

    def _shared(self) -> SharedInputs:
        # Streams share nothing: to wait for one another would cost more than drawing twice.
        return SharedInputs(self.samples.inputs, readers=1 if self._on_device else 2)


def _precision(name: str, device: torch.device) -> torch.dtype:
    if name == "auto":
        gpu = device.type == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False)
        name = "bfloat16" if gpu else "float32"
    return torch.bfloat16 if name == "bfloat16" else torch.float32


def _device_of(team: Team | None, device: torch.device) -> torch.device:
    """``device``; where ranks share a machine, each of them has a GPU of its own there."""
    if team is None or device.type != "cuda" or ":" in str(device):
        return device
    if team.place >= torch.cuda.device_count():
        raise UserError(
            f"{team.neighbours} ranks are on {team.hosts[team.rank]}, which has "
            f"{torch.cuda.device_count()} GPUs; start one rank for each"
        )
    torch.cuda.set_device(team.place)  # what NCCL goes by
    return torch.device("cuda", team.place)
