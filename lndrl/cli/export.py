"""``lndrl export``: a policy as an ONNX file and its contract, for a robot without lndrl."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import same_command
from lndrl.cli.help import say_next
from lndrl.cli.notes import say_origin
from lndrl.cli.options import TrustModules, trust
from lndrl.cli.signals import telling
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.policy.export import Exported


@telling(lambda: f"no file was written half; begin again with: {same_command()}")
def export(
    policy: Annotated[
        str,
        typer.Argument(
            metavar="RUN_OR_WEIGHTS", help="Run folder, checkpoint, weights file or 'shipped'."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(metavar="FILE.onnx", help="The model; its contract becomes FILE.json."),
    ],
    observations: Annotated[
        int,
        typer.Option(metavar="N", min=1, help="Compared with the policy on so many, really met."),
    ] = 1000,
    json: Annotated[bool, typer.Option("--json", help="Say it as one JSON object.")] = False,
    trust_modules: TrustModules = None,
) -> None:
    """Write a policy as an ONNX file that a robot runs without lndrl, and its contract."""
    _check(out)
    trust(trust_modules)
    from lndrl.policy import read_policy
    from lndrl.policy.export import check_installed, export_policy

    check_installed()
    found = read_policy(policy)
    say_origin(policy, found.origin, found.temperature)
    exported = export_policy(found.config, found.weights, policy, observations)
    try:
        exported.write(out)
    except OSError as error:
        raise UserError(f"--out {out}: cannot be written ({error.strerror})") from None
    if json:
        typer.echo(json_format.dumps(_figures(out, exported)))
        return
    typer.echo(_words(out, exported))
    say_next(then="docs/deployment.md has ten lines that run it without lndrl")


def _check(out: Path) -> None:
    if out.suffix.lower() != ".onnx":
        raise UserError(f"--out {out}: must end in .onnx")
    if not out.parent.is_dir():
        raise UserError(f"--out {out}: there is no folder {out.parent}")
    beside = out.with_suffix(".json")
    if beside.exists() and not _is_contract(beside):
        raise UserError(
            f"--out {out}: its contract would replace {beside}, which is something else; name "
            "another file"
        )


def _is_contract(path: Path) -> bool:
    """Whether an earlier export has written ``path``."""
    try:
        found = json_format.loads(path.read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(found, dict) and "contract" in found and "actions" in found


def _figures(out: Path, exported: Exported) -> dict[str, object]:
    from lndrl.policy.export import contract_beside

    return {
        "model": str(out),
        "contract": str(contract_beside(out)),
        "bytes": len(exported.model),
        "opset": exported.contract["opset"],
        "observations": exported.trip.observations,
        "largest_difference": exported.trip.difference,
        "decisions_per_second": exported.rates[0],
        "decisions_per_second_of_lndrl": exported.rates[1],
    }


def _words(out: Path, exported: Exported) -> str:
    from lndrl.policy.export import contract_beside

    said, trip = exported.contract["policy"], exported.trip
    steps = "" if said["steps"] is None else f" after {said['steps']:,} steps"
    if said["temperature"] != 1.0:
        steps += f", at temperature {said['temperature']:g}"
    onnx, lndrl = exported.rates
    return (
        f"{out}: the policy{steps}, {len(exported.model) / 1e6:.1f} MB, opset "
        f"{exported.contract['opset']}; contract in {contract_beside(out)}\n"
        f"round trip: {trip.observations:,} observations met in {said['scenario']}, largest "
        f"difference of a log-probability {trip.difference:.1e} ({trip.tolerance:.0e} allowed)\n"
        f"one core, one decision at a time: ONNX Runtime {onnx:.0f} decisions/s, lndrl {lndrl:.0f}"
    )
