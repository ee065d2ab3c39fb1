"""Pages about every key of every file, from the models that read them."""

from __future__ import annotations

from docs.site.reference.text import code, plain, said, table
from lndrl.config import SOURCES, Key, RunConfig, keys
from lndrl.models import Model


def configuration_pages() -> dict[str, str]:
    """One page about configurations of runs, one about the other files."""
    return {"configuration.md": _of_runs(), "files.md": _of_others()}


def _of_runs() -> str:
    known = list(keys(RunConfig).values())
    tops = [key for key in known if "." not in key.name]
    plainly = [key for key in tops if key.is_value]
    parts = [_OPENING, f"## At the top\n\n{_rows(plainly)}"]
    for top in tops:
        if top.is_value or top.name == "scenario":
            continue
        inner = [key for key in known if key.name.startswith(f"{top.name}.")]
        parts.append(f"## {top.name}\n\n{plain(top.description)}\n\n{_rows(inner)}")
    parts.append("## scenario\n\nA name, or the keys of [a scenario](files.md#scenarios).")
    sources = table(
        ("in brackets", "is"), [(code(name), plain(text)) for name, text in SOURCES.items()]
    )
    parts.append(f"## Where numbers come from\n\n{sources}")
    return "\n\n".join(parts) + "\n"


_OPENING = """# Configuration

Keys of a run's YAML file, as `lndrl config explain KEY` says them. Any of them can be changed on
the command line, `--set ppo.epochs=2`, or in a file that begins with `base: lndrl.yaml`. A key
that is unknown or out of its limits is refused with a sentence; `lndrl config show NAME` prints
all keys of a configuration, `lndrl config diff A B` those in which two differ, and `lndrl config
schema` what editors complete and check by."""


def _of_others() -> str:
    from lndrl.evaluation.benchmark.calibration import CalibrationSpec
    from lndrl.evaluation.benchmark.spec import BenchmarkSpec
    from lndrl.evaluation.sweep.spec import SweepSpec
    from lndrl.placement.cluster import ClusterConfig
    from lndrl.robot.shapes import RobotShape
    from lndrl.scenario import Scenario

    kinds: dict[str, type[Model]] = {
        "Scenarios": Scenario,
        "Sweeps": SweepSpec,
        "Benches": BenchmarkSpec,
        "Calibrations": CalibrationSpec,
        "Robots": RobotShape,
        "Clusters": ClusterConfig,
    }
    parts = [
        "# Other files\n\nKeys of the YAML files beside a run's, from the models that read them."
    ]
    for title, model in kinds.items():
        parts.append(f"## {title}\n\n{said(model.__doc__)}\n\n{_rows(list(keys(model).values()))}")
    return "\n\n".join(parts) + "\n"


def _rows(found: list[Key]) -> str:
    return table(
        ("key", "what it is", "may be", "default"),
        [
            (
                code(key.name),
                plain(key.description),
                plain(key.kind) if key.is_value else "keys",
                _default(key),
            )
            for key in found
        ],
    )


def _default(key: Key) -> str:
    if not key.is_value:
        return ""
    return key.default if key.default.startswith("none;") else code(key.default)
