"""Damaged files end in a sentence, whatever is wrong with them."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.chaos.files import FileFindings, fuzz_files
from lndrl.config import load_config
from lndrl.errors import UserError
from lndrl.models import load_yaml

FILES = 250


def test_damaged_files_are_refused_with_a_sentence(tmp_path: Path) -> None:
    found = fuzz_files(FILES, 1, tmp_path)
    assert found.examples == []
    assert (found.given, found.crashes) == (FILES, 0)
    assert found.refused > FILES / 2
    assert set(found.kinds) == {
        "configuration", "scenario", "map", "map image", "checkpoint", "policy",
    }  # fmt: skip


def test_findings_tell_crashes_from_refusals() -> None:
    found = FileFindings()
    for error in (None, UserError("no"), ValueError("no"), KeyError("boom"), RecursionError()):
        found.note("map", "flip", error)
    assert (found.given, found.refused, found.crashes) == (5, 2, 2)
    assert "KeyError" in found.examples[0]


@settings(max_examples=100)
@given(st.text(max_size=200) | st.binary(max_size=200))
def test_any_text_is_a_mapping_or_a_sentence(tmp_path_factory, content: str | bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    data = content.encode(errors="ignore") if isinstance(content, str) else content
    path.write_bytes(data)
    for load in (load_yaml, load_config):
        try:
            load(path)
        except UserError as error:
            assert "any.yaml" in str(error)


@pytest.mark.parametrize(
    "text",
    [
        "a: " + "[" * 2000,
        "a: 2001-99-99",
        "a: &x [*x]",
        "? [a]\n: b",
        "a: 0x",
        "1: 2",
        "a: 1:99:99",
    ],
)
def test_yaml_that_trips_its_parser_is_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "odd.yaml"
    path.write_text(text)
    with pytest.raises(UserError, match=r"odd\.yaml"):
        load_config(path)
