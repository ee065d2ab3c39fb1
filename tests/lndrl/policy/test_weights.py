"""Weights in and out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lndrl.errors import UserError
from lndrl.policy import (
    build_policy,
    initial_weights,
    load_into,
    load_policy,
    policy_metadata,
    read_policy,
    to_bytes,
)
from tests.lndrl.policy.built_in import built_in
from tests.lndrl.policy.test_networks import make_config

CONFIG = make_config(map_channels=(4, 4, 4), features=16, goal_features=4)


def test_weights_that_are_not_finite_are_refused() -> None:
    for odd in ("nan", "inf", "-inf"):
        network = built_in(build_policy(CONFIG))
        network.head.weight.data[0, 0] = float(odd)
        with pytest.raises(UserError, match=r"head\.weight.*not finite"):
            load_into(build_policy(CONFIG), to_bytes(network))


def saved(folder: Path, steps: int, **more: str) -> bytes:
    """A policy as checkpoints have it; no two are alike."""
    folder.mkdir(parents=True)
    network = build_policy(CONFIG.model_copy(update={"seed": steps}))
    blob = to_bytes(network, {**policy_metadata(CONFIG, 1, steps), **more})
    (folder / "policy.safetensors").write_bytes(blob)
    return blob


def test_of_a_run_the_best_is_taken_else_the_newest_and_said(tmp_path: Path) -> None:
    place = tmp_path / "checkpoints"
    old, new = (saved(place / f"step-{step:09d}", step) for step in (999_950_000, 10**9))
    found = read_policy(tmp_path)
    assert found.weights == new and found.origin == "newest checkpoint, step 1,000,000,000"
    counts = json.dumps({"episodes": 200, "arrived": 188})
    best = saved(place / "best", 81_920, **{"lndrl.validated": counts})
    found = read_policy(tmp_path)
    assert found.weights == best == load_policy(tmp_path)[1]
    assert found.origin == "best checkpoint, step 81,920, 0.94 of 200 validated"
    for name, blob in (("newest", new), ("best", best), ("step-999950000", old)):
        assert read_policy(tmp_path, name).weights == blob
    assert read_policy(place / "step-999950000").weights == old
    assert read_policy(place / "step-999950000").origin == "an older checkpoint, step 999,950,000"
    assert read_policy(place / "best" / "policy.safetensors").weights == best


@pytest.mark.parametrize("name", ["step-000000001", "../best", "", "policy.safetensors"])
def test_a_checkpoint_that_is_not_there_is_named(tmp_path: Path, name: str) -> None:
    saved(tmp_path / "checkpoints" / "best", 5)
    with pytest.raises(UserError, match=r"has no checkpoint .*; there are: best"):
        read_policy(tmp_path, name)
    with pytest.raises(UserError, match="has no checkpoint newest"):
        read_policy(tmp_path, "newest")


@pytest.mark.parametrize("counts", ["no JSON", "[]", '{"arrived": 1, "episodes": 0}', "{}"])
def test_odd_counts_in_a_file_are_left_out(tmp_path: Path, counts: str) -> None:
    saved(tmp_path / "checkpoints" / "best", 5, **{"lndrl.validated": counts})
    assert read_policy(tmp_path).origin == "best checkpoint, step 5"


def test_missing_and_empty_places_are_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such run folder"):
        load_policy(tmp_path / "nothing")
    with pytest.raises(UserError, match="holds no checkpoint yet"):
        load_policy(tmp_path)
    plain = tmp_path / "plain.safetensors"
    plain.write_bytes(initial_weights(CONFIG))
    with pytest.raises(UserError, match="no configuration"):
        load_policy(plain)
