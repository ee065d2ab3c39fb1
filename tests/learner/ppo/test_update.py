"""The PPO update on a problem whose answer is known."""

from __future__ import annotations

import threading
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch

from learner.ppo.adam import Adam
from learner.ppo.batch import assemble, batch_advantages, way_to_goal, way_value
from learner.ppo.losses import policy_loss
from learner.ppo.update import PPO, DivergedError
from lndrl.machine.threads import kept_threads, set_threads
from lndrl.navigation import Observation
from lndrl.navigation.privileged.floats import GOAL_UNIT, NAMES
from lndrl.policy import prepare
from tests.learner.helpers_learner import random_trajectory, small_config
from tests.lndrl.machine.blas import blas_threads


@pytest.fixture
def ppo():
    made = []

    def make(**settings):
        made.append(PPO(small_config(ppo=settings)))
        return made[-1]

    yield make
    for each in made:
        each.close()


def test_parts_are_multiplied_by_one_thread_each(ppo) -> None:
    """Both networks multiply hundreds of small parts at once; more threads would only wait."""
    with kept_threads():
        set_threads(2)
        ppo()
        assert blas_threads() == {1}


def bandit_batch(ppo: PPO, good: int):
    """Every step ends the episode; only action ``good`` pays."""
    trajectory = random_trajectory(ppo.config, seed=1, steps=32, worlds=4)
    none = np.zeros_like(trajectory.truncated)
    trajectory = replace(
        trajectory,
        terminated=np.ones_like(none),
        truncated=none,
        action=np.random.default_rng(2).integers(0, 28, none.shape).astype(np.uint8),
        final_index=np.zeros(0, np.int32),
        final_observation=trajectory.final_observation.take(slice(0, 0)),
    )
    return assemble([replace(trajectory, reward=np.float32(100.0) * (trajectory.action == good))])


@pytest.mark.parametrize("joint", [False, True])
def test_the_action_that_pays_becomes_likelier(ppo, joint: bool) -> None:
    trainer = ppo(actor_learning_rate=3e-3, epochs=6, joint_gradient_norm=joint)
    batch = bandit_batch(trainer, good=5)

    def probability() -> float:
        with torch.no_grad():
            logits = trainer.policy(prepare(batch.observation, trainer.config))
        return float(torch.softmax(logits, 1)[:, 5].mean())

    before = probability()
    figures = trainer.update(batch, progress=0.0)
    assert probability() > 1.3 * before
    assert figures["kl"] > 0
    assert figures["learning_rate"] == pytest.approx(3e-3)


def test_the_value_net_learns_its_targets(ppo) -> None:
    trainer = ppo(critic_learning_rate=3e-3, epochs=8)
    batch = bandit_batch(trainer, good=5)
    losses = [trainer.update(batch, 0.0)["value_loss"] for _ in range(4)]
    assert losses[-1] < 0.8 * losses[0]


def test_same_seed_same_bits(ppo) -> None:
    results = []
    for _ in range(2):
        trainer = ppo()
        batch = assemble([random_trajectory(trainer.config, seed) for seed in (3, 4)])
        figures = trainer.update(batch, 0.25)
        results.append((figures, [p.detach().clone() for p in trainer.policy.parameters()]))
    assert results[0][0] == results[1][0]
    assert all(torch.equal(a, b) for a, b in zip(results[0][1], results[1][1], strict=True))


def test_each_networks_thread_is_called_once(ppo) -> None:
    trainer, names = ppo(), []
    trainer.each_thread(lambda: names.append(threading.current_thread().name))
    assert sorted(names) == ["policy_0", "value_0"]
    with pytest.raises(ZeroDivisionError):
        trainer.each_thread(lambda: 1 // 0)


def test_a_network_is_trained_in_its_own_thread_and_keeps_no_gradient(ppo) -> None:
    """So that its memory is nearly empty between updates, and can go back to the system."""
    seen: set[tuple[str, str]] = set()
    trainer = ppo()
    for name in ("policy", "value"):

        def note(*_: object, name: str = name) -> None:
            seen.add((name, threading.current_thread().name))

        getattr(trainer, name).register_forward_hook(note)
    batch = assemble([random_trajectory(trainer.config, seed) for seed in (3, 4)])
    for _ in range(20):
        trainer.update(batch, 0.0)
    assert seen == {("policy", "policy_0"), ("value", "value_0")}
    assert all(p.grad is None for n in (trainer.policy, trainer.value) for p in n.parameters())


def test_moments_are_made_where_training_is_called(ppo, monkeypatch) -> None:
    makers = []

    def begin(self: Adam, parameter: torch.Tensor) -> dict[str, torch.Tensor]:
        makers.append(threading.current_thread())
        return make(self, parameter)

    make = Adam._begin
    monkeypatch.setattr(Adam, "_begin", begin)
    trainer = ppo()
    trainer.update(assemble([random_trajectory(trainer.config, 3)]), 0.0)
    assert set(makers) == {threading.main_thread()}


def test_linear_schedule_ends_at_zero_and_target_kl_stops(ppo) -> None:
    trainer = ppo(target_kl=1e-9, epochs=5, actor_learning_rate=1e-2)
    batch = assemble([random_trajectory(trainer.config, 5)])
    assert trainer.update(batch, 1.0)["learning_rate"] == 0.0
    steps = trainer.policy_optimizer.state[next(trainer.policy.parameters())]["step"]
    before = int(steps)
    trainer.update(batch, 0.0)
    # 16 samples are one minibatch: the first epoch moves the policy, the second sees it and stops.
    assert int(steps) - before == 2


def test_full_batch_step_equals_its_parts(ppo) -> None:
    """A full-batch step in pieces of 512 rows has the gradient of the whole."""
    trainer = ppo(minibatch_size=None, epochs=1, gradient_norm=1e9)
    batch = assemble([random_trajectory(trainer.config, s, steps=40, worlds=16) for s in (1, 2)])
    assert len(batch) > 1024
    target = np.random.default_rng(0).normal(size=len(batch)).astype(np.float32)
    whole = deepcopy(trainer.value)
    trainer.train(batch, batch.log_prob, target, target)
    value = whole(prepare(batch.observation, trainer.config)).squeeze(1)
    (0.5 * (value - torch.from_numpy(target)).square().mean()).backward()
    for piece, parameter in zip(trainer.value.parameters(), whole.parameters(), strict=True):
        gradient = trainer.value_optimizer.state[piece]["exp_avg"] / 0.1  # after Adam's first step
        torch.testing.assert_close(gradient, parameter.grad, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("joint", [False, True])
def test_gradients_are_clipped_as_torch_clips_them(ppo, joint: bool) -> None:
    """Adam's first step by hand: the moments of a clipped gradient."""
    trainer = ppo(
        minibatch_size=None, epochs=1, gradient_norm=1e-3, joint_gradient_norm=joint, value_loss=7.0
    )
    batch = assemble([random_trajectory(trainer.config, 4)])
    target = np.random.default_rng(0).normal(size=len(batch)).astype(np.float32)
    networks = [deepcopy(trainer.policy), deepcopy(trainer.value)]
    figures = trainer.train(batch, batch.log_prob, target, target)
    inputs = prepare(batch.observation, trainer.config)
    loss = policy_loss(
        networks[0](inputs),
        torch.from_numpy(batch.action),
        torch.from_numpy(batch.log_prob),
        torch.from_numpy(batch.log_prob),
        torch.from_numpy(target),
        *(0.2, None, 0.01, 10.0),
    )
    loss.total.backward()
    (7.0 * (networks[1](inputs).squeeze(1) - torch.from_numpy(target)).square().mean()).backward()
    groups = [networks] if joint else [[network] for network in networks]
    norms = [
        float(
            torch.nn.utils.clip_grad_norm_([p for n in group for p in n.parameters()], 1e-3),
        )
        for group in groups
    ]
    assert figures["gradient_norm_policy"] == pytest.approx(norms[0], rel=1e-4)
    assert figures["gradient_norm_value"] == pytest.approx(norms[-1], rel=1e-4)
    optimizers = (trainer.policy_optimizer, trainer.value_optimizer)
    for network, trained, optimizer in zip(
        networks, (trainer.policy, trainer.value), optimizers, strict=True
    ):
        for expected, parameter in zip(network.parameters(), trained.parameters(), strict=True):
            moment = optimizer.state[parameter]["exp_avg"]
            torch.testing.assert_close(moment, 0.1 * expected.grad, rtol=1e-3, atol=1e-9)


def test_bfloat16_keeps_float32_weights_and_learns_about_the_same() -> None:
    figures = {}
    for precision in ("float32", "bfloat16"):
        config = small_config(learner={"precision": precision})
        trainer = PPO(config)
        batch = assemble([random_trajectory(config, seed) for seed in (3, 4)])
        figures[precision] = trainer.update(batch, 0.0)
        assert all(p.dtype == torch.float32 for p in trainer.policy.parameters())
        moments = [trainer.policy_optimizer.state[p] for p in trainer.policy.parameters()]
        assert all(moment["exp_avg"].dtype == torch.float32 for moment in moments)
        trainer.close()
    for name in ("policy_loss", "value_loss", "entropy", "gradient_norm_value"):
        assert figures["bfloat16"][name] == pytest.approx(figures["float32"][name], rel=0.05)
    assert figures["bfloat16"]["value_loss"] != figures["float32"]["value_loss"]


def test_non_finite_input_is_said(ppo) -> None:
    trainer = ppo()
    trajectory = random_trajectory(trainer.config, 6)
    trajectory.reward[0, 0] = np.nan
    with pytest.raises(DivergedError, match="loss"):
        trainer.update(assemble([trajectory]), 0.0)


def test_batch_advantages_go_chunk_by_chunk() -> None:
    config = small_config()
    chunks = [random_trajectory(config, seed) for seed in (7, 8)]
    batch = assemble(chunks)
    rng = np.random.default_rng(0)
    value = rng.normal(size=len(batch)).astype(np.float32)
    final = rng.normal(size=len(batch.final_observation)).astype(np.float32)
    advantage, target = batch_advantages(batch, value, final, config.ppo)
    half, cut = len(batch) // 2, len(chunks[0].final_index)
    alone, _ = batch_advantages(assemble(chunks[1:]), value[half:], final[cut:], config.ppo)
    np.testing.assert_array_equal(advantage[half:], alone)
    np.testing.assert_allclose(target, advantage + value, rtol=1e-5)


@pytest.mark.parametrize("knows", [False, True])
def test_what_the_way_pays_may_stand_beside_the_network(knows: bool) -> None:
    """Advantages are the same, whoever of the two says what a state is worth."""
    config = small_config(
        ppo={"way_value": True, "gamma": 0.998}, learner={"privileged_critic": knows}
    )
    batch = assemble([random_trajectory(config, seed) for seed in (7, 8)])
    rng = np.random.default_rng(0)
    value = rng.normal(size=len(batch)).astype(np.float32)
    final = rng.normal(size=len(batch.final_observation)).astype(np.float32)
    per_metre = way_value(config)
    assert per_metre == pytest.approx(0.01 * config.task.reward.approach)
    way = per_metre * way_to_goal(batch.observation, batch.privileged)
    ahead = per_metre * way_to_goal(batch.final_observation, batch.final_privileged)
    together, whole = batch_advantages(batch, value + way, final + ahead, config.ppo)
    beside, rest = batch_advantages(batch, value, final, config.ppo, per_metre)
    np.testing.assert_allclose(beside, together, atol=1e-4)
    np.testing.assert_allclose(rest + way, whole, atol=1e-4)
    assert way.min() > 0.0
    off = config.model_copy(update={"ppo": config.ppo.model_copy(update={"way_value": False})})
    assert way_value(off) == 0.0


def test_the_way_is_the_true_one_where_the_critic_may_know_it() -> None:
    """As the actors' kernel squashes it; else the way that the robot believes in."""
    observation = Observation.zeros(2)
    observation.goal[:, :2] = [[3.0, 4.0], [0.0, -0.5]]
    np.testing.assert_allclose(way_to_goal(observation, None), [5.0, 0.5])
    known = np.zeros((2, len(NAMES)), np.float32)
    true = np.array([[-6.0, 8.0], [0.3, 0.0]])
    known[:, [NAMES.index("goal_x"), NAMES.index("goal_y")]] = np.sign(true) * np.log1p(
        np.abs(true) / GOAL_UNIT
    )
    np.testing.assert_allclose(way_to_goal(observation, known), [10.0, 0.3], rtol=1e-5)


def test_chunks_of_different_lengths_may_be_mixed() -> None:
    config = small_config()
    sizes = [(8, 2), (5, 3), (8, 4), (5, 1)]
    chunks = [
        random_trajectory(config, seed, steps=t, worlds=b) for seed, (t, b) in enumerate(sizes)
    ]
    batch = assemble(chunks)
    rng = np.random.default_rng(0)
    value = rng.normal(size=len(batch)).astype(np.float32)
    final = rng.normal(size=len(batch.final_observation)).astype(np.float32)
    together = batch_advantages(batch, value, final, config.ppo)
    sample = cut = 0
    for chunk in chunks:
        rows = slice(sample, sample + chunk.action.size)
        cuts = slice(cut, cut + len(chunk.final_index))
        alone = batch_advantages(assemble([chunk]), value[rows], final[cuts], config.ppo)
        for whole, part in zip(together, alone, strict=True):
            np.testing.assert_array_equal(whole[rows], part)
        sample, cut = rows.stop, cuts.stop


def test_group_setting_treats_a_timeout_as_an_end() -> None:
    config = small_config(ppo={"bootstrap_truncated": False})
    trajectory = random_trajectory(config, 9)
    batch = assemble([trajectory])
    value = np.zeros(len(batch), np.float32)
    final = np.full(len(batch.final_observation), 50.0, np.float32)
    advantage, _ = batch_advantages(batch, value, final, config.ppo)
    timeouts = trajectory.truncated.astype(bool).reshape(-1)
    assert timeouts.any()
    np.testing.assert_allclose(
        advantage[timeouts], 0.01 * trajectory.reward.reshape(-1)[timeouts], rtol=1e-5
    )


def held(trainer: PPO) -> list[torch.Tensor]:
    """Weights and moments themselves."""
    found = []
    for network, optimizer in (
        (trainer.policy, trainer.policy_optimizer),
        (trainer.value, trainer.value_optimizer),
    ):
        for parameter in network.parameters():
            moments = optimizer.state.get(parameter, {})
            found += [parameter, *(moments[name] for name in sorted(moments))]
    return found


def everything(trainer: PPO) -> list[torch.Tensor]:
    """Copies of weights and moments."""
    return [tensor.detach().clone() for tensor in held(trainer)]


def spoil_reward(trainer: PPO, monkeypatch, batch) -> None:
    batch.trajectories[0].reward[0, 0] = np.nan


def spoil_gradient_late(trainer: PPO, monkeypatch, batch) -> None:
    """The last gradients of the value network alone, when the policy has moved already."""
    steps, original = [0], trainer._critic.norm

    def norm():
        steps[0] += 1
        return original() * (np.inf if steps[0] % 4 == 0 else 1.0)

    monkeypatch.setattr(trainer._critic, "norm", norm)


def spoil_weights(trainer: PPO, monkeypatch, batch) -> None:
    """Losses and gradients look well and the weights are not."""
    original = trainer._actor.figures

    def figures():
        with torch.no_grad():
            trainer._actor.parameters[-1].view(-1)[0] = np.inf
        return original()

    monkeypatch.setattr(trainer._actor, "figures", figures)


def spoil_moments(trainer: PPO, monkeypatch, batch) -> None:
    original = trainer._critic.figures

    def figures():
        trainer.value_optimizer.state[trainer._critic.parameters[0]]["exp_avg"].view(-1)[0] = np.nan
        return original()

    monkeypatch.setattr(trainer._critic, "figures", figures)


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize("spoil", [spoil_reward, spoil_gradient_late, spoil_weights, spoil_moments])
def test_a_spoilt_update_leaves_no_trace(ppo, monkeypatch, spoil, first: bool, joint: bool) -> None:
    """Weights, moments and the order of minibatches, even where Adam had no moments yet."""
    trainer, twin = (ppo(joint_gradient_norm=joint) for _ in range(2))

    def good(seed: int):
        return assemble([random_trajectory(trainer.config, seed + n) for n in (0, 1)])

    if not first:
        for each in (trainer, twin):
            each.update(good(10), 0.0)
    before = everything(trainer)
    places = [tensor.data_ptr() for tensor in trainer.policy.parameters()]
    batch = good(20)
    with monkeypatch.context() as patch:
        spoil(trainer, patch, batch)
        for _ in range(2):
            with pytest.raises(DivergedError):
                trainer.update(batch, 0.0)
    assert trainer.is_finite()
    if not first:
        for was, found, other in zip(before, held(trainer), held(twin), strict=True):
            is_moment = found.ndim and not found.requires_grad
            near = 2.0**-8 if is_moment else 0.0  # moments are kept in bfloat16
            torch.testing.assert_close(found.detach(), was, rtol=near, atol=0.0)
            with torch.no_grad():
                found.copy_(other)  # so that what follows can be compared bit for bit
    assert places == [tensor.data_ptr() for tensor in trainer.policy.parameters()], "graphs"
    assert trainer.update(good(30), 0.0) == twin.update(good(30), 0.0)
    for one, other in zip(everything(trainer), everything(twin), strict=True):
        assert torch.equal(one, other)


def test_the_safeguard_takes_its_memory_once(ppo) -> None:
    trainer = ppo()
    places = []
    for seed in range(3):
        trainer.update(assemble([random_trajectory(trainer.config, seed)]), 0.0)
        places.append({copy.data_ptr() for copy in trainer._safeguard._copies.values()})
    assert places[0] < places[1] == places[2], "weights, then moments, then nothing new"
