"""Checkpoints: complete, atomic, checked."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load as load_tensors

from learner.ppo.batch import assemble
from learner.ppo.update import PPO
from learner.run.checkpoint import (
    TRAINED_FILE,
    Counters,
    clean_up,
    find_checkpoint,
    load_checkpoint,
    save_checkpoint,
    set_aside_later,
    start_from,
)
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.numbering import checkpoints_in
from lndrl.policy import load_policy, policy_metadata, to_bytes
from tests.learner.helpers_learner import random_trajectory, small_config

BOOKS = {"roster": {"actors": {"a": 0}, "sequences": [["a", "x", 4, [6]]]}}


@pytest.fixture
def trained():
    """A maker of PPO objects that have learned from a batch or two."""
    made: list[PPO] = []

    def make(config: RunConfig, updates: int) -> PPO:
        ppo = PPO(config)
        made.append(ppo)
        for seed in range(updates):
            ppo.update(assemble([random_trajectory(config, seed)]), 0.0)
        return ppo

    yield make
    for ppo in made:
        ppo.close()


def test_training_goes_on_bit_for_bit(trained, tmp_path: Path) -> None:
    config = small_config()
    first = trained(config, 2)
    path = save_checkpoint(tmp_path, first, Counters(steps=64, updates=2, version=2), BOOKS, 3)
    second = trained(config, 0)
    counters, books = load_checkpoint(path, second)
    assert (counters.steps, counters.version, books) == (64, 2, BOOKS)
    batch = assemble([random_trajectory(config, 99)])
    assert first.update(batch, 0.5) == second.update(batch, 0.5)
    for one, other in zip(first.policy.parameters(), second.policy.parameters(), strict=True):
        assert torch.equal(one, other)


def test_the_newest_few_are_kept_and_no_partial_one_remains(trained, tmp_path: Path) -> None:
    ppo = trained(small_config(), 1)
    for steps in (10, 20, 30):
        save_checkpoint(tmp_path, ppo, Counters(steps=steps), BOOKS, keep=2)
    assert [p.name for p in checkpoints_in(tmp_path)] == ["step-000000020", "step-000000030"]
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_a_disk_that_refuses_leaves_the_old_ones(trained, tmp_path: Path, monkeypatch) -> None:
    ppo = trained(small_config(), 1)
    path = save_checkpoint(tmp_path, ppo, Counters(steps=10), BOOKS, 2)

    def refuse(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("learner.run.checkpoint.os.fsync", refuse)
    with pytest.raises(OSError, match="space"):
        save_checkpoint(tmp_path, ppo, Counters(steps=20), BOOKS, 2)
    assert checkpoints_in(tmp_path) == [path]


def test_a_billion_steps_come_after_fewer(trained, tmp_path: Path) -> None:
    """As text, step-1000000000 stands before step-999950000."""
    ppo = trained(small_config(), 1)
    for steps in (999_900_000, 999_950_000, 1_000_000_000):
        newest = save_checkpoint(tmp_path, ppo, Counters(steps=steps), BOOKS, keep=2)
    assert [p.name for p in checkpoints_in(tmp_path)] == ["step-999950000", "step-1000000000"]
    assert find_checkpoint(tmp_path, None) == newest
    (tmp_path / "step-2000000000.copy").mkdir()
    assert find_checkpoint(tmp_path, None) == newest, "a user's copy is no checkpoint"
    (newest / "value.safetensors").unlink()
    with pytest.raises(UserError, match=r"--checkpoint step-999950000, the one before"):
        load_checkpoint(newest, ppo)
    assert set_aside_later(tmp_path / "step-999950000") == ["step-1000000000"]
    assert set_aside_later(tmp_path / "step-999950000") == []


@pytest.mark.parametrize("file", ["policy.safetensors", "optimizer.safetensors", "state.json"])
def test_damage_is_found_and_the_one_before_is_offered(trained, tmp_path: Path, file: str) -> None:
    ppo = trained(small_config(), 1)
    for steps in (10, 20):
        path = save_checkpoint(tmp_path, ppo, Counters(steps=steps), BOOKS, 3)
    data = bytearray((path / file).read_bytes())
    data[len(data) // 2] ^= 0xFF
    (path / file).write_bytes(data[: len(data) - 3] if file == "state.json" else data)
    with pytest.raises(UserError, match=r"damaged.*--checkpoint step-000000010"):
        load_checkpoint(path, ppo)


def test_another_network_is_named(trained, tmp_path: Path) -> None:
    path = save_checkpoint(tmp_path, trained(small_config(), 1), Counters(), BOOKS, 3)
    other = trained(small_config(network={"features": 24}), 0)
    sentence = r"policy\.safetensors: trained with 16 features; this configuration has 24 features"
    with pytest.raises(UserError, match=sentence):
        load_checkpoint(path, other)


def test_another_network_is_named_where_a_file_of_its_own_holds_what_is_trained(
    trained, tmp_path: Path
) -> None:
    averaging = {"learner": {"average": 0.9}}
    path = save_checkpoint(tmp_path, trained(small_config(**averaging), 1), Counters(), BOOKS, 3)
    other = trained(small_config(network={"layer_norm": True}, **averaging), 0)
    sentence = r"trained with no layer norm; this configuration has a layer norm"
    with pytest.raises(UserError, match=sentence):
        load_checkpoint(path, other)


def test_find_checkpoint_names_what_there_is(trained, tmp_path: Path) -> None:
    config = small_config()
    with pytest.raises(UserError, match="holds no checkpoint"):
        find_checkpoint(tmp_path, None)
    path = save_checkpoint(tmp_path, trained(config, 0), Counters(steps=10), BOOKS, 3)
    assert find_checkpoint(tmp_path, None) == path
    with pytest.raises(UserError, match="step-000000010"):
        find_checkpoint(tmp_path, "step-000000011")


def test_the_policy_file_alone_says_how_to_run_it(trained, tmp_path: Path) -> None:
    config = small_config()
    path = save_checkpoint(tmp_path / "checkpoints", trained(config, 0), Counters(), BOOKS, 3)
    for place in (tmp_path, path, path / "policy.safetensors"):
        found, blob = load_policy(place)
        assert found == config
        assert blob == (path / "policy.safetensors").read_bytes()
    other = config.model_copy(update={"seed": 7})
    for steps, saved in ((10**9, other), (999_950_000, config)):
        save_checkpoint(tmp_path / "checkpoints", trained(saved, 0), Counters(steps), BOOKS, 3)
    assert load_policy(tmp_path)[0] == other, "the newest of the run's"


def test_a_run_begins_with_the_networks_of_another(trained, tmp_path: Path) -> None:
    config = small_config()
    old = trained(config, 2)
    save_checkpoint(tmp_path / "checkpoints", old, Counters(steps=64), BOOKS, 3)
    new = trained(config.model_copy(update={"seed": 5}), 0)
    order = new.rng.bit_generator.state
    assert start_from(tmp_path, new).name == "step-000000064"
    assert new.rng.bit_generator.state == order, "the new run's seed orders its minibatches"
    for one, other in zip(old.value.parameters(), new.value.parameters(), strict=True):
        assert torch.equal(one, other)
    assert all("exp_avg" in new.value_optimizer.state[p] for p in new.value.parameters())
    with pytest.raises(UserError, match="nowhere holds no checkpoint"):
        start_from(tmp_path / "nowhere", new)


def test_a_run_begins_with_the_policy_of_a_file(trained, tmp_path: Path) -> None:
    config = small_config()
    old, new = trained(config, 2), trained(config, 0)
    file = tmp_path / "policy.safetensors"
    file.write_bytes(to_bytes(old.policy, policy_metadata(config, 3, 64)))
    value = [parameter.clone() for parameter in new.value.parameters()]
    assert start_from(file, new) == file
    for one, other in zip(old.policy.parameters(), new.policy.parameters(), strict=True):
        assert torch.equal(one, other)
    for one, other in zip(value, new.value.parameters(), strict=True):
        assert torch.equal(one, other), "a policy file knows no values"


def test_a_policy_file_of_another_layout_is_refused(trained, tmp_path: Path) -> None:
    config = small_config()
    file = tmp_path / "policy.safetensors"
    file.write_bytes(to_bytes(trained(config, 0).policy, policy_metadata(config, 3, 64)))
    wider = config.task.model_copy(update={"map_extent": 10.0})
    with pytest.raises(UserError, match=r"learner\.start: .*policy\.safetensors: trained with"):
        start_from(file, trained(config.model_copy(update={"task": wider}), 0))
    (tmp_path / "text.md").write_text("no policy")
    with pytest.raises(UserError, match=r"learner\.start: .*not a safetensors file"):
        start_from(tmp_path / "text.md", trained(config, 0))


def test_a_run_begins_with_the_shipped_policy(trained) -> None:
    config = load_policy("shipped")[0]
    new = trained(config, 0)
    assert start_from("shipped", new) == Path("shipped")
    shipped = load_tensors(load_policy("shipped")[1])
    for name, parameter in new.policy.named_parameters():
        assert torch.equal(parameter, shipped[name])


def test_a_run_begins_with_a_certain_checkpoint_of_another(trained, tmp_path: Path) -> None:
    config = small_config()
    older, newer = trained(config, 2), trained(config, 3)
    for steps, ppo in ((64, older), (96, newer)):
        save_checkpoint(tmp_path / "checkpoints", ppo, Counters(steps=steps), BOOKS, 3)
    new = trained(config, 0)
    chosen = tmp_path / "checkpoints/step-000000064"
    assert start_from(chosen, new) == chosen
    for one, other in zip(older.policy.parameters(), new.policy.parameters(), strict=True):
        assert torch.equal(one, other)


def test_an_average_is_what_is_tested_and_training_goes_on_from_the_weights(
    trained, tmp_path: Path
) -> None:
    config = small_config(learner={"average": 0.9})
    first = trained(config, 3)
    path = save_checkpoint(tmp_path, first, Counters(steps=64, updates=3), BOOKS, 3)
    tested = load_tensors(load_policy(path)[1])
    for name, weights in first.average.network.state_dict().items():
        assert torch.equal(tested[name], weights)
        assert not torch.equal(weights, first.policy.state_dict()[name])
    second = trained(config, 0)
    load_checkpoint(path, second)
    batch = assemble([random_trajectory(config, 99)])
    assert first.update(batch, 0.5) == second.update(batch, 0.5)
    for mine, theirs in ((first.policy, second.policy), (first.tested, second.tested)):
        for one, other in zip(mine.parameters(), theirs.parameters(), strict=True):
            assert torch.equal(one, other)
    # A run that averages no more goes on from the weights, too, not from their average.
    without = trained(small_config(), 0)
    load_checkpoint(path, without)
    assert without.update(batch, 0.5) == trained_again(trained, config, path).update(batch, 0.5)


def trained_again(trained, config: RunConfig, path: Path) -> PPO:
    ppo: PPO = trained(config, 0)
    load_checkpoint(path, ppo)
    return ppo


def test_a_checkpoint_without_an_average_begins_one(trained, tmp_path: Path) -> None:
    old = trained(small_config(), 2)
    path = save_checkpoint(tmp_path, old, Counters(steps=64, updates=2), BOOKS, 3)
    assert not (path / TRAINED_FILE).exists()
    new = trained_again(trained, small_config(learner={"average": 0.9}), path)
    assert new.average is not None and new.average.updates == 0
    for one, other in zip(old.policy.parameters(), new.tested.parameters(), strict=True):
        assert torch.equal(one, other)
    new.update(assemble([random_trajectory(new.config, 99)]), 0.5)
    for one, other in zip(new.policy.parameters(), new.tested.parameters(), strict=True):
        assert torch.equal(one, other), "one update alone is its own average"


def test_a_missing_or_spoilt_average_is_damage(trained, tmp_path: Path) -> None:
    ppo = trained(small_config(learner={"average": 0.9}), 1)
    path = save_checkpoint(tmp_path, ppo, Counters(steps=64, updates=1), BOOKS, 3)
    spoilt = path / TRAINED_FILE
    spoilt.write_bytes(spoilt.read_bytes()[:-1])
    with pytest.raises(UserError, match=r"damaged \(trained.safetensors is not what was written"):
        load_checkpoint(path, ppo)
    spoilt.unlink()
    with pytest.raises(UserError, match="damaged"):
        load_checkpoint(path, ppo)


def test_a_critic_that_knows_more_begins_with_what_one_that_knew_less_has_learned(
    trained, tmp_path: Path
) -> None:
    plain, knowing = small_config(), small_config(learner={"privileged_critic": True})
    old = trained(plain, 2)
    save_checkpoint(tmp_path / "checkpoints", old, Counters(steps=64), BOOKS, 3)
    new = trained(knowing, 0)
    start_from(tmp_path, new)
    batch = assemble([random_trajectory(knowing, 7)])
    for ppo in (old, new):
        ppo._load(batch)
    before, after = (ppo._forward(batch)[1] for ppo in (old, new))
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-6)  # nobody listens to it yet
    moments = new.value_optimizer.state[new.value.trunk.weight]["exp_avg"]
    features = knowing.network.goal_features
    assert torch.equal(
        moments[:, :-features], old.value_optimizer.state[old.value.trunk.weight]["exp_avg"]
    )
    assert not moments[:, -features:].any()
    new.update(batch, 0.0)
    assert new.value.trunk.weight[:, -features:].abs().max() > 0
    save_checkpoint(tmp_path / "checkpoints", new, Counters(steps=128), BOOKS, 3)
    again = trained(knowing, 0)
    start_from(tmp_path, again)
    for one, other in zip(new.value.parameters(), again.value.parameters(), strict=True):
        assert torch.equal(one, other)
    expected = r"saw privileged floats.*set learner\.privileged_critic: true"
    with pytest.raises(UserError, match=expected):
        start_from(tmp_path, trained(plain, 0))


def test_what_a_full_disk_left_behind_is_removed(trained, tmp_path: Path, monkeypatch) -> None:
    ppo = trained(small_config(), 1)
    path = save_checkpoint(tmp_path, ppo, Counters(steps=10), BOOKS, 2)
    for failing in range(1, 6):
        left = failing

        def flush(descriptor: int) -> None:
            nonlocal left
            left -= 1
            if not left:
                raise OSError(28, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr("learner.run.checkpoint.os.fsync", flush)
            with pytest.raises(OSError, match="space"):
                save_checkpoint(tmp_path, ppo, Counters(steps=20), BOOKS, 2)
        for kept in checkpoints_in(tmp_path):
            load_checkpoint(kept, ppo)
        assert path in checkpoints_in(tmp_path)
        assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_a_checkpoint_replaces_one_of_its_name_without_a_gap(
    trained, tmp_path: Path, monkeypatch
) -> None:
    """A writer killed between two renames leaves the old one to be found again."""
    ppo = trained(small_config(), 1)
    path = save_checkpoint(tmp_path, ppo, Counters(steps=10, updates=1), BOOKS, 1)
    original, calls = Path.rename, []

    def rename(self: Path, target: Path) -> Path:
        calls.append(self.name)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return original(self, target)

    monkeypatch.setattr(Path, "rename", rename)
    with pytest.raises(KeyboardInterrupt):
        save_checkpoint(tmp_path, ppo, Counters(steps=10, updates=2), BOOKS, 1)
    monkeypatch.undo()
    assert checkpoints_in(tmp_path) == []
    assert clean_up(tmp_path) == [".step-000000010.partial"]
    assert list(tmp_path.iterdir()) == [path]
    assert load_checkpoint(path, ppo)[0].updates == 1
    save_checkpoint(tmp_path, ppo, Counters(steps=10, updates=2), BOOKS, 1)
    assert list(tmp_path.iterdir()) == [path]
    assert load_checkpoint(path, ppo)[0].updates == 2


def test_going_back_sets_what_came_later_aside(trained, tmp_path: Path) -> None:
    ppo = trained(small_config(), 0)
    for steps in (10, 20, 30):
        save_checkpoint(tmp_path, ppo, Counters(steps=steps), BOOKS, 3)
    assert set_aside_later(tmp_path / "step-000000010") == ["step-000000020", "step-000000030"]
    save_checkpoint(tmp_path, ppo, Counters(steps=15), BOOKS, 1)
    assert find_checkpoint(tmp_path, None).name == "step-000000015"
    assert (tmp_path / "abandoned-step-000000030").is_dir()


@pytest.mark.parametrize(
    "key, value",
    [
        ("counters", {"steps": -1}),
        ("counters", {"steps": "many"}),
        ("counters", {"steps": 1, "jumps": 2}),
        ("counters", {"elapsed": float("inf")}),
        ("counters", None),
        ("generator", {"bit_generator": "MT19937"}),
        ("generator", []),
        ("learning_rates", [0.1]),
        ("learning_rates", ["x", "y"]),
        ("digests", {}),
        ("digests", 3),
        ("format", 2),
    ],
)
def test_states_that_no_learner_wrote_are_refused(trained, tmp_path: Path, key, value) -> None:
    ppo = trained(small_config(), 0)
    path = save_checkpoint(tmp_path, ppo, Counters(steps=10), BOOKS, 3)
    state = json.loads((path / "state.json").read_text())
    state[key] = value
    (path / "state.json").write_text(json.dumps(state))
    with pytest.raises(UserError, match=r"not what was written|format"):
        load_checkpoint(path, ppo)
    del state["digest"]  # as checkpoints were before there was one
    (path / "state.json").write_text(json.dumps(state))
    with pytest.raises(UserError, match=r"damaged|format"):
        load_checkpoint(path, ppo)


def test_moments_that_are_no_numbers_are_refused(trained, tmp_path: Path) -> None:
    ppo = trained(small_config(), 1)
    moments = ppo.policy_optimizer.state[next(ppo.policy.parameters())]
    moments["exp_avg"].view(-1)[0] = float("nan")
    path = save_checkpoint(tmp_path, ppo, Counters(steps=10), BOOKS, 3)
    with pytest.raises(UserError, match="moments are not finite"):
        load_checkpoint(path, trained(small_config(), 0))
