#!/usr/bin/env bash
# eclipse-zenoh 1.10.2: unknown keys of a configuration are refused by name, but not under
# connect/retry and listen/retry. There a misspelt key is read without a word, and the retry that was
# asked for does not happen: every value stays null (the defaults).
#
# For deployments: read a configuration back (Config.get_json) and compare it with what was written.
# Exit 0: it is as described. Exit 1: it has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
"$folder/venv/bin/python" - <<'PYTHON'
import json
from importlib.metadata import version

import zenoh


def read(text: str, key: str = "connect/retry") -> object:
    try:
        return json.loads(zenoh.Config.from_json5(text).get_json(key))
    except zenoh.ZError as error:
        return f"refused: {str(error).partition(',')[0]}"


DEFAULTS = {"period_init_ms": None, "period_max_ms": None, "period_increase_factor": None}
seen = {
    "right": read("{connect: {retry: {period_init_ms: 500}}}"),
    "misspelt under connect/retry": read("{connect: {retry: {period_initial_ms: 500}}}"),
    "misspelt under listen/retry": read("{listen: {retry: {period_initial_ms: 500}}}", "listen/retry"),
    "misspelt under connect": read("{connect: {retri: {}}}"),
    "misspelt under scouting": read("{scouting: {dellay: 500}}"),
}
expected = {
    "right": {**DEFAULTS, "period_init_ms": 500},
    "misspelt under connect/retry": DEFAULTS,
    "misspelt under listen/retry": DEFAULTS,
    "misspelt under connect": "refused: unknown field `retri`",
    "misspelt under scouting": "refused: unknown field `dellay`",
}
print("eclipse-zenoh", version("eclipse-zenoh"))
for what, value in seen.items():
    print(f"{what}: {value}")
raise SystemExit(0 if seen == expected else "it has changed")
PYTHON
