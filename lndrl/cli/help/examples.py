"""Examples for the end of each help page; the tests parse every one of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from lndrl.cli.help.exits import exit_code_lines

_LINE = 78  # columns


class Example(NamedTuple):
    """A command line after ``lndrl``, and in some words what it does."""

    line: str
    does: str


def _of(*pairs: tuple[str, str]) -> tuple[Example, ...]:
    return tuple(Example(line, does) for line, does in pairs)


EXAMPLES: dict[str, tuple[Example, ...]] = {
    "": _of(
        ("demo", "a trained policy walks"),
        ("train --run first", "train one of your own"),
        ("evaluate runs/first", "measure it"),
    ),
    "demo": _of(
        ("demo", "in hybrid"),
        ("demo --scenario hall --shield", "among 18 people, with the shield"),
        ("demo --out walk.gif", "as an animation"),
    ),
    "train": _of(
        ("train --run first --steps 20000", "a short run"),
        ("train --run first --resume", "go on with it"),
        ("train reward_alone --set ppo.epochs=2 seed=7", "other settings"),
    ),
    "train-all": _of(
        ("train-all --steps 20000", "short runs of every row"),
        ("train-all --methods lndrl,no_reward", "two rows"),
    ),
    "learner": _of(
        ("learner --run first", "for actors on this machine"),
        ("learner --listen tls/0.0.0.0:7447 --certs certs", "for others, too"),
        ("learner --run first --resume", "go on with it"),
    ),
    "actor": _of(
        ("actor --connect tcp/127.0.0.1:7447 --count auto", "one per core"),
        ("actor --connect tls/LEARNER:7447 --certs certs --count 8", "others"),
    ),
    "evaluator": _of(
        ("evaluator --connect tcp/127.0.0.1:7447", "of a learner on this machine"),
        ("evaluator --connect tls/LEARNER:7447 --certs certs", "from elsewhere"),
    ),
    "runs": _of(
        ("runs", "all, the newest first"),
        ("runs compare runs/a runs/b", "in what two differ"),
        ("runs rm a", "remove one; asks first"),
    ),
    "runs compare": _of(("runs compare runs/a runs/b", "keys and figures that differ")),
    "runs rm": _of(
        ("runs rm first", "asks first"),
        ("runs rm first second --yes", "does not ask"),
    ),
    "metrics": _of(
        ("metrics --connect tcp/127.0.0.1:7447", ""),
        ("metrics --connect tls/LEARNER:7447 --certs certs --port 9100", ""),
    ),
    "up": _of(
        ("up cluster.yaml", "start and watch; Ctrl-C ends all"),
        ("up cluster.yaml --detach", "start and leave"),
    ),
    "down": _of(("down cluster.yaml", "end it, with a checkpoint")),
    "site": _of(
        (
            "site --connect tls/LEARNER:7447 --listen tls/SITE:7447 --certs certs",
            "",
        ),
    ),
    "dashboard": _of(
        ("dashboard --connect tcp/127.0.0.1:7447", "live; ? shows the keys"),
        ("dashboard --connect tcp/127.0.0.1:7447 --once --json", "for a program"),
    ),
    "evaluate": _of(
        ("evaluate runs/first --scenario hall --episodes 200", "elsewhere"),
        ("evaluate shipped dwa careful --bench", "three, in the bench's world"),
        ("evaluate random straight --episodes 50", "floors to compare with"),
    ),
    "returns": _of(
        ("returns predictive careful", "at the usual discounts"),
        ("returns predictive careful --set task.reward.lost=-2000", "others"),
    ),
    "benchmark": _of(
        ("benchmark --table", "only show what is there"),
        ("benchmark --methods dwa,random --episodes 20", "two rows, roughly"),
    ),
    "results": _of(
        ("results", "your own, else those that come along"),
        ("results --reference careful --methods careful,dwa", "beside one"),
        ("results --picture results.png", "at a glance"),
    ),
    "calibrate": _of(
        ("calibrate --table", "only show what is there"),
        ("calibrate --episodes 20 --by-scenario", "a rough one, place by place"),
    ),
    "figures": _of(
        ("figures trajectories --methods dwa,careful --scenario hall", "paths"),
        ("figures worst --method dwa", "worst episodes of a result"),
    ),
    "figures behaviour": _of(
        ("figures behaviour runs/first dwa --scenario hall --episodes 200", ""),
    ),
    "figures trajectories": _of(
        ("figures trajectories --methods dwa,careful --scenario hall", ""),
    ),
    "figures activations": _of(
        ("figures activations --method lndrl --scenario hall --step 20", ""),
    ),
    "figures worst": _of(
        ("figures worst --method dwa --scenario hall --count 6", ""),
    ),
    "localization": _of(
        ("localization --scenarios hall", "one place"),
        ("localization --scenarios hall,sparse --seeds 3 --out filter.md", ""),
    ),
    "lost": _of(
        ("lost dwa --scenario hybrid", "a rule, in one place"),
        ("lost runs/first --own-world --out lost.png", "as it was trained"),
    ),
    "play": _of(
        ("play shipped --out walk.gif", "all of an episode"),
        ("play runs/first --scenario hall --episode 3 --out end.png", "its end"),
    ),
    "export": _of(
        ("export runs/first --out policy.onnx", "and policy.json"),
        ("export shipped --out policy.onnx --observations 100", "on fewer"),
    ),
    "drive": _of(
        ("drive shipped", "what lndrl robot-sim is"),
        ("drive runs/first --connect tcp/ROBOT:7447 --goal 4,1", "a robot"),
    ),
    "robot-sim": _of(
        ("robot-sim --scenario hall", "wait for a driver"),
        ("robot-sim --episodes 10 --loss 0.05 --delay 0.1", "over a bad link"),
    ),
    "replay": _of(
        ("replay drive.mcap --map building.yaml", "where the belief went"),
        ("replay drive.mcap --policy shipped --out replay.png", "a picture"),
    ),
    "scenarios": _of(
        ("scenarios", "what there is"),
        ("scenarios hall --out hall.png", "one picture"),
        ("scenarios random --layout 7 --json", "regions and routes"),
    ),
    "sweep": _of(
        ("sweep ppo", "one that comes with the program"),
        ("sweep ppo --table", "only show what is there"),
    ),
    "ship": _of(
        ("ship weights runs/school", "first"),
        ("ship results", "then"),
    ),
    "ship weights": _of(("ship weights runs/school --temperature 0.5", "")),
    "ship results": _of(("ship results --episodes 500", "")),
    "ship card": _of(("ship card", "after a change of wording")),
    "config": _of(
        ("config show", "names by kind"),
        ("config explain ppo.epochs", "one key"),
        ("config diff lndrl paper", "in what two differ"),
    ),
    "config show": _of(
        ("config show", "names by kind"),
        ("config show lndrl", "every key of one, as YAML"),
    ),
    "config explain": _of(
        ("config explain ppo.epochs", "one key"),
        ("config explain localization", "all that it holds"),
    ),
    "config diff": _of(("config diff lndrl paper", "in what two differ")),
    "config schema": _of(("config schema scenario", "of scenario files")),
    "certs": _of(
        ("certs --out certs --host learner.example 10.0.0.5", "all roles"),
        ("certs --out certs --renew actor", "one anew"),
    ),
    "doctor": _of(
        ("doctor --connect tls/LEARNER:7447 --certs certs", "as what certs holds"),
        ("doctor --connect tcp/127.0.0.1:7447 --json", "for a program"),
    ),
    "log": _of(
        ("log runs/first --to mlflow", "by MLFLOW_TRACKING_URI"),
        ("log runs/first --to wandb --follow", "as long as it trains"),
    ),
    "curves": _of(
        ("curves runs/first", "curves.png and curves.csv there"),
        ("curves runs/a runs/b --out both", "two in one picture"),
    ),
    "report": _of(
        ("report runs/first", "report.html there"),
        ("report runs/first --episodes 0", "what the folder says alone"),
        ("report results/benchmark --out results.html", "of results"),
    ),
    "chaos": _of(
        ("chaos --minutes 5 --seed 1", "all kinds of faults"),
        ("chaos --minutes 30 --only actor_freeze --pace 30", "one kind"),
        ("chaos --fuzz 10000", "malformed messages"),
    ),
    "bench": _of(
        ("bench all", "the parts, minutes"),
        ("bench train --profile", "where a training's time goes"),
        ("bench laser --peers", "beside other packages"),
    ),
    "version": _of(
        ("version", "of lndrl and what it stands on"),
        ("version --json", "for a report of a bug"),
    ),
}
"""Examples by command, subcommands as ``config show``; those of the program itself at the top."""


def example_lines(examples: Iterable[Example]) -> Iterator[str]:
    """Lines as a help page shows them, what they do in one column where that fits."""
    examples = list(examples)
    widest = max(len(each.line) for each in examples)
    for each in examples:
        width = min(widest, _LINE - len("  lndrl   # ") - len(each.does))
        yield (
            f"  lndrl {each.line:<{width}}  # {each.does}" if each.does else f"  lndrl {each.line}"
        )


def epilog(name: str) -> str:
    """What the help page of the command ``name`` ends with."""
    lines = ["Examples:", *example_lines(EXAMPLES[name])]
    if not name:
        lines += ["", "Exit codes of all commands:", *exit_code_lines()]
    return "\n".join(lines)


def with_examples(command: Any, name: str) -> Any:
    """``command``, whose help pages, those of its subcommands too, end with examples."""
    command.epilog = epilog(name)
    for inner, below in getattr(command, "commands", {}).items():
        with_examples(below, f"{name} {inner}")
    return command
