"""Options that several commands share, and the checks of their text."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, overload

import typer

from lndrl.cli.completion import complete_configuration, complete_scenario, complete_setting
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.planners import GuardConfig, PlannerSource, ShieldConfig

ConfigName = Annotated[
    str | None,
    typer.Argument(
        metavar="[CONFIG]",
        help="Name of a configuration that comes with the program (lndrl config show lists them),"
        " YAML file or run folder; default: lndrl.",
        show_default=False,
        autocompletion=complete_configuration,
    ),
]
ScenarioName = Annotated[
    str | None,
    typer.Option(
        metavar="S",
        help="Name or YAML file; default: what was trained on.",
        autocompletion=complete_scenario,
    ),
]
BenchName = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Another bench, a YAML file, with METHOD.yaml beside it; default: benchmark.",
        show_default=False,
    ),
]
RunName = Annotated[
    str | None,
    typer.Option(
        "--run",
        "--run-name",  # torchrun takes --run for one of its own
        metavar="NAME",
        help="Folder runs/NAME; else named by file and time.",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key of the configuration, e.g. ppo.epochs=4.",
        autocompletion=complete_setting,
    ),
]
Steps = Annotated[
    int | None,
    typer.Option("--steps", min=1, metavar="S", help="Stop after this many environment steps."),
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Continue runs/NAME from its newest checkpoint.")
]
CheckpointName = Annotated[
    str | None,
    typer.Option(
        "--checkpoint", metavar="STEP", help="With --resume: the checkpoint, e.g. step-000040960."
    ),
]
WhichCheckpoint = Annotated[
    str | None,
    typer.Option(
        "--checkpoint",
        metavar="newest|best|STEP",
        help="Of run folders: e.g. step-000040960; default: the best validated one, else newest.",
        show_default=False,
    ),
]
LearnerDevice = Annotated[
    str | None,
    typer.Option(
        "--device",
        metavar="DEVICE",
        help="Where the networks learn: cpu, cuda, cuda:0, or auto; cpu unless configured.",
        show_default=False,
    ),
]
Listen = Annotated[
    str | None,
    typer.Option(
        "--listen",
        metavar="ENDPOINT",
        help="Where actors and dashboards connect; tcp/127.0.0.1:7447 unless configured."
        " Other machines need tls/HOST:PORT and --certs.",
    ),
]
TrustModules = Annotated[
    list[str] | None,
    typer.Option(
        "--trust-modules",
        metavar="PREFIX",
        help="Import parts of your own (module:Class) from PREFIX and PREFIX.*, which runs their"
        " code; can be repeated.",
        show_default=False,
    ),
]
Temperature = Annotated[
    float | None,
    typer.Option(
        metavar="T",
        help="Of a policy's sampling: 1 as in training (the default), below prefers likelier"
        " actions, e.g. 0.5.",
        show_default=False,
    ),
]
PlannerSettings = Annotated[
    list[str] | None,
    typer.Option(
        "--planner-set",
        metavar="KEY=VALUE",
        help="A setting of a planner of your own, or a parameter of a rule; can be repeated.",
        show_default=False,
    ),
]
ShieldOption = Annotated[
    bool,
    typer.Option(
        "--shield",
        help="Veto what would touch somebody soon and take a policy's next best instead.",
    ),
]
GuardOption = Annotated[
    bool,
    typer.Option(
        "--guard",
        help="Let no command through that could end in a touch of what is seen (docs/guard.md).",
    ),
]
GuardSettings = Annotated[
    list[str] | None,
    typer.Option(
        "--guard-set",
        metavar="KEY=VALUE",
        help="A bound of the guard, e.g. people_speed=1.0; can be repeated.",
        show_default=False,
    ),
]
ShieldSettings = Annotated[
    list[str] | None,
    typer.Option(
        "--shield-set",
        metavar="KEY=VALUE",
        help="A parameter of the shield, e.g. horizon=0.8; can be repeated.",
        show_default=False,
    ),
]

_SCHEMES = ("tcp", "tls")
_DEVICE = re.compile(r"auto|cpu|cuda(:\d+)?")


def check_endpoint(endpoint: str, option: str) -> str:
    """``endpoint`` if it reads like tcp/HOST:PORT or tls/HOST:PORT; raises UserError otherwise."""
    scheme, slash, address = endpoint.partition("/")
    example = "write it like tcp/127.0.0.1:7447"
    if scheme == "unixsock-stream" or set(address) & set("?#"):
        raise UserError(
            f"{option} {endpoint}: is tcp/HOST:PORT or tls/HOST:PORT here; a socket file or"
            " #iface= goes into the endpoints of a file for --zenoh"
        )
    if not slash or scheme not in _SCHEMES or not address:
        raise UserError(f"{option} {endpoint}: not an endpoint; {example}")
    host, colon, port = address.rpartition(":")
    if not colon or not host or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise UserError(f"{option} {endpoint}: needs a host and a port 1 to 65535; {example}")
    return endpoint


def learner_device(device: str) -> str:
    """The override that puts the learner on ``device``; raises UserError where there is none."""
    from lndrl.policy import resolve_device

    resolve_device(device)
    return f"learner.device={device}"


def run_overrides(
    settings: list[str] | None, steps: int | None, device: str | None, listen: str | None
) -> list[str]:
    """--set and the options that are short for one, as ``key=value``; raises UserError."""
    overrides = list(settings or [])
    if steps is not None:
        overrides.append(f"learner.total_steps={steps}")
    if device is not None:
        overrides.append(learner_device(device))
    if listen is not None:
        overrides.append(f"transport.endpoint={check_endpoint(listen, '--listen')}")
        # A run that is resumed may have been behind a router before.
        overrides.append("transport.router=false")
    return overrides


def check_checkpoint(checkpoint: str | None, resume: bool) -> None:
    """Raises UserError for a checkpoint that is named although nothing is resumed."""
    if checkpoint is not None and not resume:
        raise UserError("--checkpoint goes with --resume")


def count_or_auto(text: str) -> int | str:
    """``text`` as a number of processes or "auto"; raises a usage error for anything else."""
    if text == "auto":
        return text
    if not text.isdecimal() or int(text) < 1:
        raise typer.BadParameter(f"'{text}' is neither auto nor a whole number, at least 1.")
    return int(text)


def check_device(device: str) -> str:
    """``device`` if it reads like one (cpu, cuda, cuda:0, auto); raises UserError otherwise."""
    if not _DEVICE.fullmatch(device):
        raise UserError(f"--device {device}: not a device; write cpu, cuda, cuda:0 or auto")
    return device


def check_picture(out: Path, *suffixes: str, option: str = "--out") -> None:
    """Raises UserError unless ``option`` can be a picture: it ends in one of ``suffixes`` (.png),
    in a folder that exists, and is not the image of a map, which nobody could draw again.
    """
    suffixes = suffixes or (".png",)
    if out.suffix.lower() not in suffixes:
        raise UserError(f"{option} {out}: must end in {' or '.join(suffixes)}")
    if not out.parent.is_dir():
        raise UserError(f"{option} {out}: folder {out.parent} does not exist")
    if out.is_dir():
        raise UserError(f"{option} {out}: is a folder; name a file")
    if out.exists():
        for described in sorted([*out.parent.glob("*.yaml"), *out.parent.glob("*.yml")]):
            if _is_image_of(out, described):
                raise UserError(
                    f"{option} {out}: is the image of the map {described}; name another"
                )


def _is_image_of(picture: Path, described: Path) -> bool:
    """Whether ``described`` is the YAML file of a map with the image ``picture``."""
    from lndrl.models import load_yaml  # brings pydantic along

    try:
        image = load_yaml(described).get("image")
        return isinstance(image, str) and (described.parent / image).samefile(picture)
    except (UserError, OSError, ValueError):
        return False


@overload
def names_in(text: str) -> list[str]: ...
@overload
def names_in(text: str | None) -> list[str] | None: ...
def names_in(text: str | None) -> list[str] | None:
    """The parts of ``A,B,...``; None for None."""
    return None if text is None else [part.strip() for part in text.split(",") if part.strip()]


def trust(modules: list[str] | None) -> None:
    """Let this process import parts of the user's own from ``modules``; raises UserError.

    They are looked for where Python looks, and last in the working folder.
    """
    if not modules:
        return
    from lndrl.extensions import parts_folder, trust_modules

    trust_modules(*modules)
    here = parts_folder()
    if here not in sys.path:
        sys.path.append(here)


def part_settings(settings: list[str] | None, option: str) -> dict[str, Any]:
    """``KEY=VALUE`` (YAML values) of ``option`` as keyword arguments; raises UserError."""
    import yaml

    found: dict[str, Any] = {}
    for text in settings or []:
        key, equals, value = text.partition("=")
        if not equals or not key.isidentifier():
            raise UserError(f"{option} {text}: must be KEY=VALUE, e.g. speed=0.3")
        try:
            found[key] = yaml.safe_load(value)
        except yaml.YAMLError:
            raise UserError(f"{option} {text}: {value!r} is not a YAML value") from None
    return found


def sampled(source: PlannerSource, temperature: float | None, greedy: bool) -> PlannerSource:
    """``source`` as ``--temperature`` asks for; raises UserError beside ``--greedy``."""
    if temperature is None:
        return source
    if greedy:
        raise UserError("--temperature goes with sampling, and --greedy does not sample; drop one")
    return source.at_temperature(temperature)


def of_run(planner: str, checkpoint: str | None, planners: Sequence[str]) -> str | None:
    """``checkpoint`` where ``planner`` is a run folder, None where it is none.

    Raises UserError where none of ``planners`` is one.
    """
    if checkpoint is None:
        return None
    from lndrl.config.shipped import SHIPPED_POLICIES  # brings pydantic along

    runs = [
        each
        for each in planners
        if each not in SHIPPED_POLICIES and Path(each, "checkpoints").is_dir()
    ]
    if not runs:
        raise UserError(
            f"--checkpoint {checkpoint} goes with a run folder, and {', '.join(planners)} is none"
        )
    return checkpoint if planner in runs else None


def guard_config(wanted: bool, settings: list[str] | None) -> GuardConfig | None:
    """The guard that ``--guard`` and ``--guard-set`` ask for; raises UserError."""
    if not wanted:
        if settings:
            raise UserError("--guard-set goes with --guard")
        return None
    from lndrl.models import validate
    from lndrl.planners import GuardConfig

    return validate(GuardConfig, part_settings(settings, "--guard-set"), "--guard-set")


def shield_config(wanted: bool, settings: list[str] | None) -> ShieldConfig | None:
    """The shield that ``--shield`` and ``--shield-set`` ask for; raises UserError."""
    if not wanted:
        if settings:
            raise UserError("--shield-set goes with --shield")
        return None
    from lndrl.models import validate
    from lndrl.planners import ShieldConfig

    return validate(ShieldConfig, part_settings(settings, "--shield-set"), "--shield-set")
