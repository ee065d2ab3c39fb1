"""What maintainers need to ship a policy: that half precision decides alike, and its model card."""

from lndrl.evaluation.shipping.agreement import Agreement, compare, met, outcomes_of
from lndrl.evaluation.shipping.card import (
    CARD,
    ROBOT_CARD,
    Card,
    docs_folder,
    render,
    training_facts,
    weights_facts,
)
from lndrl.evaluation.shipping.results import cell_of, measured, testing

__all__ = [
    "CARD",
    "ROBOT_CARD",
    "Agreement",
    "Card",
    "cell_of",
    "compare",
    "docs_folder",
    "measured",
    "met",
    "outcomes_of",
    "render",
    "testing",
    "training_facts",
    "weights_facts",
]
