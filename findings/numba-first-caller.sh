#!/usr/bin/env bash
# numba 0.68.1: a function under a bare @njit takes over error_model, fastmath, forceinline and _nrt
# from whichever compiled function happens to call it first, and keeps them for every later caller of
# the same types, from Python too, and with cache=True on disk for later processes. So what the same
# line computes depends on the order of calls: 1 / x of zero raises where Python was the first to call,
# and is infinity where a caller with error_model="numpy" was; a sum of fractions differs in its last
# digits once a caller with fastmath=True has been first, also in a later process that has no such
# caller.
#
# For simulators that promise the same bits: give every function all four options.
# Exit 0: it is as described. Exit 1: it has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numba==0.68.1 numpy==2.4.6
cat > "$folder/helpers.py" <<'PYTHON'
from numba import njit


@njit(cache=True)
def inverse(x):
    return 1.0 / x


@njit(cache=True)
def total(values):
    found = 0.0
    for k in range(values.size):
        found += values[k]
    return found
PYTHON
cat > "$folder/use.py" <<'PYTHON'
import sys

import numba
import numpy as np
from helpers import inverse, total
from numba import njit


@njit(error_model="numpy", fastmath=True)
def hasty(x, values):
    return inverse(x) + total(values)


values = 1.0 / np.arange(1.0, 100_001.0)
if sys.argv[1] == "hasty first":
    hasty(1.0, values)
try:
    quotient = str(inverse(0.0))
except ZeroDivisionError:
    quotient = "ZeroDivisionError"
slow = 0.0
for value in values.tolist():
    slow += value
print(numba.__version__, quotient, "as written" if total(values) == slow else "in another order")
PYTHON
look() {
    (cd "$folder" && NUMBA_CACHE_DIR="$folder/$1" venv/bin/python use.py "$2")
}
seen="$(look a 'Python first')
$(look b 'hasty first')
$(look b 'Python first')"
printf '%s\n' "$seen"
[ "$seen" = "0.68.1 ZeroDivisionError as written
0.68.1 inf in another order
0.68.1 inf in another order" ]
