"""``lndrl ship``: for maintainers, put a policy into the package and write its model card."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from lndrl.cli.again import same_command
from lndrl.cli.notes import say_origins
from lndrl.cli.signals import telling
from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores

if TYPE_CHECKING:
    from lndrl.config import RunConfig
    from lndrl.evaluation import EvaluationResult
    from lndrl.evaluation.shipping import Agreement, Card
    from lndrl.navigation import Navigation
    from lndrl.navigation.snapshot import WorldSnapshot
    from lndrl.planners import PlannerSource

_TRIES = 50  # walks, of which the first that arrives is recorded
ship = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="For maintainers: put a policy into the package, and write its model card.",
)
Workers = Annotated[
    int | None,
    typer.Option(metavar="W", min=0, help="Processes; default: one per core; 0: none but this."),
]
Docs = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Where model-card.json and model-card.md lie; default: docs of this checkout.",
        show_default=False,
    ),
]


@ship.command("weights")
@telling(lambda: f"nothing was written; begin again with: {same_command()}")
def weights(
    run: Annotated[str, typer.Argument(metavar="RUN_OR_WEIGHTS", help="What is to be shipped.")],
    name: Annotated[
        Literal["shipped", "shipped-robot"],
        typer.Option("--as", help="Its name; shipped-robot has a model card of its own."),
    ] = "shipped",
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Default: the package's own policy.", show_default=False),
    ] = None,
    observations: Annotated[
        int, typer.Option(metavar="N", min=1, help="On which decisions are compared.")
    ] = 2500,
    episodes: Annotated[
        int, typer.Option(metavar="N", min=1, help="Driven with both, in each of the five places.")
    ] = 60,
    temperature: Annotated[
        float | None,
        typer.Option(
            metavar="T",
            help="What it is meant to be sampled at, in the file from then on; default: its own.",
            show_default=False,
        ),
    ] = None,
    workers: Workers = None,
    docs: Docs = None,
) -> None:
    """Write a policy in half precision, unless that changes decisions beyond noise.

    Both are compared on observations that the policy meets, and in the same episodes; the
    figures go into the model card.
    """
    from lndrl.config.shipped import SHIPPED_POLICY
    from lndrl.evaluation.shipping import (
        CARD,
        ROBOT_CARD,
        Card,
        docs_folder,
        training_facts,
        weights_facts,
    )
    from lndrl.policy.shipped import (
        LARGEST_FILE,
        ROBOT_FILE,
        SHIPPED_FILE,
        WALK_FILE,
        narrowed,
        parameters_in,
        widened,
    )

    folder = docs or docs_folder()
    source, metadata = _to_ship(run, temperature)
    assert source.config is not None and source.weights is not None
    half = narrowed(source.weights, metadata, run)
    if len(half) > LARGEST_FILE:
        raise UserError(f"{run}: {len(half):,} bytes in half precision, {LARGEST_FILE:,} may be")
    shipped = replace(source, weights=widened(half, metadata))
    agreement = _agreement(source, shipped, observations, episodes, _workers(workers))
    _say(agreement)
    if agreement.complaints:
        typer.echo(f"nothing was written: {'; '.join(agreement.complaints)}", err=True)
        raise typer.Exit(1)
    usual = name == SHIPPED_POLICY
    target = out or (SHIPPED_FILE if usual else ROBOT_FILE)
    try:
        target.write_bytes(half)
    except OSError as error:
        raise UserError(f"--out {target}: cannot be written ({error.strerror})") from None
    card = Card(
        weights_facts(half, parameters_in(half)),
        training_facts(source.config, metadata),
        agreement.to_dict(),
    )
    card.write(folder, CARD if usual else ROBOT_CARD)
    if usual:
        _record(shipped, target.with_name(WALK_FILE.name), card.weights["sha256"])
    following = "lndrl ship results" if usual else "lndrl benchmark --spec benchmark-robot"
    typer.echo(f"{target}: {len(half):,} bytes; next: {following}")


@ship.command("results")
def results(
    episodes: Annotated[
        int, typer.Option(metavar="N", min=1, help="Per place, with and without the shield.")
    ] = 500,
    workers: Workers = None,
    docs: Docs = None,
) -> None:
    """Measure the shipped policy in the bench's five places, and write its model card.

    The episodes are those of lndrl evaluate shipped --bench; what is there is kept.
    """
    from lndrl.config.shipped import SHIPPED_POLICY
    from lndrl.evaluation.benchmark import load_benchmark
    from lndrl.evaluation.shipping import Card, cell_of, docs_folder, measured
    from lndrl.planners import planner_source

    folder = docs or docs_folder()
    source, bench = planner_source(SHIPPED_POLICY), load_benchmark()
    card = Card.read(folder)
    _check_weights(card)
    rows: list[dict[str, object]] = []
    cells = [(place, shield) for shield in (False, True) for place in bench.scenarios]

    def kept() -> str:
        return f"{len(rows)} of {len(cells)} rows are kept in {folder}; go on with: "

    with telling(lambda: kept() + same_command()):
        for place, shield in cells:
            chosen, config = cell_of(source, bench, place, shield)
            wanted = {
                "scenario": config.scenario.name,
                "shield": shield,
                "episodes": episodes,
                "seed": bench.seed,
            }
            known = [row for row in card.results if wanted.items() <= row.items()]
            if not known:
                result = _driven(chosen, config, episodes, bench.seed, _workers(workers))
                known = [measured(result)]
            rows.append(known[0])
            replace(card, results=rows).write(folder)
    typer.echo(f"{folder / 'model-card.md'}: {len(rows)} rows of {episodes:,} episodes each")


@ship.command("card")
def card(docs: Docs = None) -> None:
    """Write the tables of the model cards anew from their JSON files; measure nothing."""
    from lndrl.evaluation.shipping import CARD, ROBOT_CARD, Card, docs_folder

    folder = docs or docs_folder()
    for stem in (CARD, ROBOT_CARD):
        if (folder / f"{stem}.json").is_file():
            Card.read(folder, stem).write(folder, stem)


def _to_ship(run: str, temperature: float | None) -> tuple[PlannerSource, dict[str, str]]:
    """The policy of ``run``, sampled at ``temperature``, and what its file is to say of itself."""
    from lndrl.planners import planner_source
    from lndrl.policy import TEMPERATURE_KEY
    from lndrl.policy.blob import metadata_in

    source = planner_source(run)
    if source.weights is None:
        raise UserError(f"{run}: has no weights to ship; give a run folder or a weights file")
    metadata = metadata_in(source.weights)
    if temperature is not None:
        source = source.at_temperature(temperature)
    say_origins([source])
    metadata.pop(TEMPERATURE_KEY, None)
    if source.temperature != 1.0:
        metadata[TEMPERATURE_KEY] = repr(source.temperature)
    return source, metadata


def _workers(asked: int | None) -> int:
    return usable_cores() if asked is None else asked


def _check_weights(card: Card) -> None:
    """Rows of other weights must not stay: the card is of what lies in the package."""
    import hashlib

    from lndrl.policy.shipped import SHIPPED_FILE

    found = hashlib.sha256(SHIPPED_FILE.read_bytes()).hexdigest()
    if card.weights.get("sha256") != found:
        raise UserError(
            f"model-card.json is of other weights than {SHIPPED_FILE}; write both with "
            "lndrl ship weights RUN"
        )


def _agreement(
    single: PlannerSource, half: PlannerSource, observations: int, episodes: int, workers: int
) -> Agreement:
    from lndrl.evaluation.benchmark import load_benchmark
    from lndrl.evaluation.shipping import compare, met, testing
    from lndrl.view.progress import progress_bar

    bench = load_benchmark()
    configs = [testing(single, bench, place) for place in bench.scenarios]
    with progress_bar(len(configs), "observations", "places") as advance:
        seen = met(single, configs, observations, advance)
    driven = [
        [
            record
            for config in configs
            for record in _driven(source, config, episodes, bench.seed, workers).records
        ]
        for source in (single, half)
    ]
    assert single.config is not None and single.weights is not None and half.weights is not None
    return compare(single.config, single.weights, half.weights, seen, (driven[0], driven[1]))


def _into(walk: list[WorldSnapshot]) -> Callable[[Navigation], None]:
    return lambda world: walk.append(world.snapshot())


def _record(source: PlannerSource, file: Path, digest: str) -> None:
    """Write the first walk that arrives to ``file``, for who waits for ``lndrl demo``."""
    from lndrl.evaluation import EpisodeRunner
    from lndrl.view.recorded import walk_bytes

    assert source.config is not None
    runner = EpisodeRunner(source, source.config.model_copy(update={"seed": 0}))
    for episode in range(_TRIES):
        walk: list[WorldSnapshot] = []
        (record,) = runner([episode], _into(walk))
        if record.outcome == "arrived":
            break
    file.write_bytes(walk_bytes(walk, digest))


def _driven(
    source: PlannerSource, config: RunConfig, episodes: int, seed: int, workers: int
) -> EvaluationResult:
    from lndrl.evaluation import evaluate
    from lndrl.view.progress import progress_bar

    title = f"{source.label} on {config.scenario.name}"
    with progress_bar(episodes, title, "episodes") as advance:
        return evaluate(source, config, episodes, seed, workers, progress=lambda _: advance())


def _say(agreement: Agreement) -> None:
    a = agreement
    typer.echo(
        f"{a.observations:,} observations: log-probabilities differ by {a.greatest:.4f} at most "
        f"({a.greatest_likely:.4f} for likely actions); {100 * a.greedy_changed:.3f} % of greedy "
        f"and {100 * a.sampled_changed:.3f} % of sampled decisions are others"
    )
    typer.echo(
        f"{a.episodes:,} episodes: {a.arrived[0]:,} arrived in single and {a.arrived[1]:,} in half "
        f"precision (p {a.p:.2f}), {a.other_outcomes:,} ended otherwise"
    )
