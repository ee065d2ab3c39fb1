"""``lndrl bench robot``: how soon a robot is told what to do, and whether rehearsals are honest."""

from lndrl.bench.robot.drives import compare, measure

__all__ = ["compare", "measure"]
