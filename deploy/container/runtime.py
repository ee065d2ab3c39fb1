"""The packages of requirements.lock that a running lndrl needs: prints their lines.

    python deploy/container/runtime.py requirements.lock

What only tests, types, exports and trackers need stays out. A new package is in, unless it is
named here.
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

TRACKERS = {
    *("anyio", "cachetools", "certifi", "charset-normalizer", "click", "cwevals"),
    *("databricks-sdk", "distro", "fastapi", "gitdb", "GitPython", "google-auth"),
    *("googleapis-common-protos", "h11", "httpcore", "httpx", "idna", "importlib_metadata"),
    *("mlflow-skinny", "opentelemetry-api", "opentelemetry-exporter-http-transport"),
    *("opentelemetry-exporter-otlp-common", "opentelemetry-exporter-otlp-proto-common"),
    *("opentelemetry-exporter-otlp-proto-http", "opentelemetry-proto", "opentelemetry-sdk"),
    *("opentelemetry-semantic-conventions", "platformdirs", "pyasn1", "pyasn1_modules"),
    *("python-dotenv", "requests", "smmap", "sniffio", "sqlparse", "starlette", "urllib3"),
    *("uvicorn", "wandb", "zipp"),
}
"""What lndrl log needs, for Weights & Biases and MLflow: 136 MB."""


def runtime(lines: list[str]) -> list[str]:
    """Those of ``lines`` (NAME==VERSION) that are not of DEVELOPMENT or TRACKERS alone."""
    pinned = [line for line in lines if line and not line.startswith("#")]
    return [line for line in pinned if line.partition("==")[0] not in DEVELOPMENT | TRACKERS]


if __name__ == "__main__":
    print("\n".join(runtime(Path(sys.argv[1]).read_text("utf-8").splitlines())))
