"""``lndrl bench NAME --vs COMMIT``: this program beside an older one of its own, in turns.

The commit is taken out of the repository that this program runs from, into a cache folder, and
measured by its own ``lndrl bench`` under the same interpreter and packages. Every round gives one
ratio.
"""

from lndrl.bench.versus.builds import Other, prepare
from lndrl.bench.versus.turns import FIGURES, compare, table

__all__ = ["FIGURES", "Other", "compare", "prepare", "table"]
