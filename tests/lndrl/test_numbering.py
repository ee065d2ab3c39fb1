"""Names with numbers in the order of the numbers."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lndrl.numbering import BEST, by_number, checkpoint_name, checkpoints_in, step_of


@pytest.mark.parametrize(
    "ordered",
    [
        ["actor-2", "actor-10", "actor-100"],
        ["step-999950000", "step-1000000000", "step-1000049152"],
        ["host-9-2", "host-9-10", "host-10-1"],
        ["ledger.jsonl", "ledger.jsonl.1", "ledger.jsonl.9", "ledger.jsonl.10"],
        ["2", "10", "a", "a1", "b"],
        ["s01", "s1", "s02"],
        ["", "a"],
        ["a" + "9" * 5000, "a1" + "0" * 5000],
        ["a٣", "b"],
    ],
)
def test_numbers_count_as_numbers(ordered: list[str]) -> None:
    assert sorted(reversed(ordered), key=by_number) == ordered
    paths = [Path("/runs", name) for name in ordered]
    assert sorted(reversed(paths), key=by_number) == paths


@given(st.lists(st.text(alphabet="a-0129٣", max_size=8)))
def test_the_order_is_one_for_all_names(names: list[str]) -> None:
    assert sorted(names, key=by_number) == sorted(reversed(names), key=by_number)


@given(st.integers(0, 10**15), st.integers(0, 10**15))
def test_checkpoints_are_ordered_by_their_steps(one: int, other: int) -> None:
    names = sorted({checkpoint_name(one), checkpoint_name(other)}, key=by_number)
    assert [step_of(Path(name)) for name in names] == sorted({one, other})


def test_only_folders_of_that_name_are_checkpoints(tmp_path: Path) -> None:
    for name in ("step-1000000000", "step-999950000", "step-000000064.old", ".step-1.partial"):
        (tmp_path / name).mkdir()
    (tmp_path / BEST).mkdir()  # a policy without optimizers: nothing to go on from
    (tmp_path / "abandoned-step-000000128").mkdir()
    (tmp_path / "step-000000192").write_text("")
    found = [path.name for path in checkpoints_in(tmp_path)]
    assert found == ["step-999950000", "step-1000000000"]
    assert checkpoints_in(tmp_path / "nowhere") == []
    with pytest.raises(ValueError, match=r"step-000000064\.old is not the name of a checkpoint"):
        step_of(tmp_path / "step-000000064.old")
