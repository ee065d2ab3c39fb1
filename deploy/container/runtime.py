"""The packages of requirements.lock that a running lndrl needs: prints their lines.

    python deploy/container/runtime.py requirements.lock

What only tests, types and exports need stays out. A new package is in, unless it is named here.
"""

from __future__ import annotations

import sys
from pathlib import Path

DEVELOPMENT = {
    *("ast_serialize", "execnet", "flatbuffers", "hatchling", "hypothesis", "iniconfig"),
    *("librt", "ml_dtypes", "mypy", "mypy_extensions", "onnx", "onnx-ir", "onnxruntime"),
    *("onnxscript", "pathspec", "pluggy", "pytest", "pytest-xdist", "ruff", "sortedcontainers"),
    *("tomlkit", "trove-classifiers", "types-PyYAML", "kubernetes-validate", "jsonschema"),
    *("jsonschema-specifications", "referencing", "rpds-py", "attrs", "importlib_resources"),
    "mcap-ros2-support",
}


def runtime(lines: list[str]) -> list[str]:
    """Those of ``lines`` (NAME==VERSION) that are not of DEVELOPMENT alone."""
    pinned = [line for line in lines if line and not line.startswith("#")]
    return [line for line in pinned if line.partition("==")[0] not in DEVELOPMENT]


if __name__ == "__main__":
    print("\n".join(runtime(Path(sys.argv[1]).read_text("utf-8").splitlines())))
