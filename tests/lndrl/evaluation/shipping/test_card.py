from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lndrl.config import load_config
from lndrl.errors import UserError
from lndrl.evaluation.shipping import Card, docs_folder, render, training_facts, weights_facts

PAGE = """before
<!-- lndrl ship: weights -->
old
<!-- end -->
between
<!-- lndrl ship: precision -->
<!-- end -->
<!-- lndrl ship: results -->
| old |
<!-- end -->
after
"""


def row(scenario: str, shield: bool, arrived: int = 8) -> dict[str, Any]:
    return {
        "scenario": scenario, "shield": shield, "episodes": 10, "seed": 0, "program_version": "1",
        "arrival": arrived, "collision": 10 - arrived, "lost": 0, "stuck": 0, "steps": 500,
        "vetoes": 50 if shield else None, "reach_time": 20.0, "position_error": 0.1,
    }  # fmt: skip


def card() -> Card:
    config = load_config("lndrl", ["learner.total_steps=5000", "ppo.epochs=3"])
    return Card(
        weights_facts(b"some", 4),
        training_facts(config, {"lndrl.steps": "5120", "lndrl.version": "3"}),
        {
            "observations": 2500, "greatest": 0.0018, "greatest_likely": 0.0012,
            "greedy_changed": 0.0, "sampled_changed": 0.001, "episodes": 80, "arrived": [38, 37],
            "other_outcomes": 1, "p": 1.0,
        },
        [row("hall", False), row("sparse", False, 10), row("hall", True)],
    )  # fmt: skip


def test_the_blocks_are_filled_and_the_rest_is_kept() -> None:
    page = render(PAGE, card())
    assert page.startswith("before\n") and page.endswith("<!-- end -->\nafter\n")
    assert "old" not in page and "between" in page
    assert "| trained in, last | hybrid, 5,120 control steps, 3 updates, seed 1 |" in page
    (changed,) = (line for line in page.splitlines() if "other than in `lndrl.yaml`" in line)
    assert set(changed.split(" | ")[1].removesuffix(" |").split("; ")) == {
        "`learner.total_steps: 5000`",
        "`ppo.epochs: 3`",
    }
    assert "| sampled decisions that are others, with the same noise | 0.100 % |" in page
    assert "| hall | no | 0.800 (" in page and "| hall | yes | 0.800 (" in page
    assert "| **all** | no | 0.900 (" in page and page.count("**all**") == 1
    assert "| 10.0 % | 10 |" in page  # vetoed in 50 of 500 steps
    assert render(page, card()) == page


def test_an_empty_card_says_so_and_a_block_of_no_name_is_refused() -> None:
    assert render(PAGE, Card()).count("Nothing is known yet.") == 3
    with pytest.raises(UserError, match="block other is none of weights, precision, results"):
        render("<!-- lndrl ship: other -->\n<!-- end -->", Card())


def test_it_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    (tmp_path / "model-card.md").write_text(PAGE)
    assert Card.read(tmp_path) == Card()
    card().write(tmp_path)
    assert Card.read(tmp_path) == card()
    assert (tmp_path / "model-card.md").read_text() == render(PAGE, card())
    (tmp_path / "model-card.json").write_text('{"wheels": 3}')
    with pytest.raises(UserError, match=r"model-card.json: not the data of a model card"):
        Card.read(tmp_path)


def test_our_own_page_is_that_of_its_data() -> None:
    folder = docs_folder()
    page = (folder / "model-card.md").read_text()
    assert page == render(page, Card.read(folder)), "say: lndrl ship card"
