from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.policy.shipped import SHIPPED_FILE, WALK_FILE
from lndrl.view.recorded import recorded_walk, walk_bytes
from lndrl.view.walk import walk_picture, walk_words


def test_a_walk_that_was_recorded_looks_as_it_did(
    world: Callable[..., WorldSnapshot], tmp_path: Path
) -> None:
    walked = [world(steps=k) for k in range(3)]
    file = tmp_path / "walk.npz"
    file.write_bytes(walk_bytes(walked, "abc"))
    found, weights = recorded_walk(file)
    assert weights == "abc" and [each.steps for each in found] == [0, 1, 2]
    for one, two in zip(walked, found, strict=True):
        assert np.array_equal(one.occupied, two.occupied) and one.size == two.size
        assert walk_words(one) == walk_words(two)
        assert walk_picture(one, 79, 20, False).plain == walk_picture(two, 79, 20, False).plain


def test_a_file_that_is_none_is_no_walk(tmp_path: Path) -> None:
    assert recorded_walk(tmp_path / "none.npz") == ([], "")
    (tmp_path / "odd.npz").write_bytes(b"PK no archive")
    assert recorded_walk(tmp_path / "odd.npz") == ([], "")


def test_our_own_is_one_of_the_shipped_policy_and_small() -> None:
    walk, weights = recorded_walk(WALK_FILE)
    assert weights == hashlib.sha256(SHIPPED_FILE.read_bytes()).hexdigest()
    assert len(walk) > 5 and WALK_FILE.stat().st_size < 200_000
