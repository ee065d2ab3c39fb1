"""The command ``lndrl``: one small file per subcommand, imported when it is called.

``lndrl.cli.help`` has the exit codes and the examples at the end of each help page.
"""

from __future__ import annotations

import io
import os
import re
import signal
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from lndrl.caches import NOWHERE
from lndrl.cli.again import remember
from lndrl.cli.help import with_examples
from lndrl.cli.help.examples import epilog
from lndrl.errors import UserError
from lndrl.machine.cores import limit_threads
from lndrl.machine.signals import stop_handler

# What `lndrl --help` shows; the rest of a command is imported only when it is called, because
# torch and numba take seconds.
SUMMARIES = {
    "demo": "Let the policy that comes with the program walk through a crowd.",
    "train": "Train a policy on this machine: one learner and its actors.",
    "train-all": "Train every learned method of the bench, one after another.",
    "learner": "Run only the learner; actors connect to it from anywhere.",
    "actor": "Run actors that simulate worlds for a learner.",
    "evaluator": "Validate the newest weights of a learner, again and again.",
    "runs": "Say which runs there are, how they stand and how two differ.",
    "metrics": "Serve a learner's status as metrics for Prometheus.",
    "up": "Start learner and actors on the hosts that a file names, and watch them.",
    "down": "End what lndrl up has started.",
    "site": "Stand between a learner and the actors of one place: weights come once.",
    "dashboard": "Watch a running learner from another terminal.",
    "evaluate": "Measure a policy with the paper's nine metrics.",
    "returns": "Say at which discount a reward pays for which planner's way of driving.",
    "benchmark": "Fill and show the paper's table: methods x scenarios x episodes.",
    "results": "Show results beside the paper, paired comparisons and the goals.",
    "calibrate": "Hold variants of the bench against the paper's DWA row.",
    "figures": "Draw trajectories, a first layer, the worst episodes, or how two methods differ.",
    "localization": "Measure the filter on recorded drives: errors, lost rate, recovery.",
    "lost": "Say why a planner or policy gets lost: how, when and where.",
    "play": "Draw an episode of a policy as a picture or an animation.",
    "export": "Write a policy as an ONNX file that runs without lndrl, and its contract.",
    "drive": "Drive a ROS 2 robot by a policy, from a machine without ROS.",
    "robot-sim": "Stand in for a ROS 2 robot, to rehearse.",
    "replay": "Run filter and policy over a recorded bag, and say where the belief went.",
    "scenarios": "List the places to train and test in, and draw them.",
    "sweep": "Compare training settings over several seeds.",
    "ship": "For maintainers: put a policy into the package, and write its model card.",
    "config": "Show, compare and explain configurations.",
    "certs": "Make certificates that let in only whom you give one.",
    "doctor": "Say in words why a connection to a learner does not work.",
    "curves": "Draw learning curves of one run or several and write them as a table.",
    "log": "Send a run's figures to Weights & Biases or MLflow.",
    "report": "Write one page about a run or about results, for any browser.",
    "chaos": "Let a run suffer faults on purpose and count that nothing is lost.",
    "bench": "Measure how fast the parts are on this machine.",
    "version": "Say which versions are installed.",
}
# Which room of lndrl.cli a command lives in; the others stand at its door.
ROOMS = {
    "training": ("train", "train-all", "sweep", "curves", "log", "runs"),
    "evaluation": (
        "demo",
        "evaluate",
        "figures",
        "localization",
        "lost",
        "play",
        "returns",
        "scenarios",
        "ship",
    ),
    "evaluation.bench": ("benchmark", "results", "calibrate"),
    "reporting": ("report",),
    "robot": ("drive", "robot-sim", "replay"),
    "fleet": (
        "learner",
        "actor",
        "evaluator",
        "site",
        "up",
        "down",
        "dashboard",
        "metrics",
        "certs",
        "doctor",
        "chaos",
    ),
}

_SETTING = re.compile(r"[A-Za-z_][\w.]*=")
# Options of `lndrl certs` that take several values.
_LISTS = ("--host", "--site-host", "--renew")
# What numba says, in an error of no kind of its own, when a module with kernels is imported.
_NUMBA_HAS_NO_PLACE = "cannot cache function"


def module_of(name: str) -> str:
    """The module that the command ``name`` lives in."""
    inner = [f"{room}." for room, names in ROOMS.items() if name in names]
    return f"lndrl.cli.{''.join(inner)}{name.replace('-', '_')}"


def load_command(name: str) -> Any:
    """The typer command ``name``: the function or group of that name in the file of that name."""
    identifier = name.replace("-", "_")
    found = getattr(import_module(module_of(name)), identifier)
    if isinstance(found, typer.Typer):
        command = get_command(found)
    else:
        app = typer.Typer(add_completion=False)
        app.command(name)(found)
        command = get_command(app)
    command.name = name
    return with_examples(command, name)


class LazyCommands(TyperGroup):
    """A group that knows its commands by name and summary and imports the one that is called."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = {name: TyperCommand(name, help=text) for name, text in SUMMARIES.items()}

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Name, imported command and its arguments; an unknown name suggests the nearest."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, load_command(name) if name else command, rest


def _show_version(wanted: bool) -> None:
    if wanted:
        from lndrl.version import VERSION

        typer.echo(VERSION)
        raise typer.Exit


app = typer.Typer(name="lndrl", cls=LazyCommands)


@app.callback(
    help="Train robots that walk through crowds and keep knowing where they are.",
    epilog=epilog(""),
)
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_show_version, is_eager=True, help="Say the version and leave."
    ),
) -> None:
    """Options before the command."""


def run(arguments: Sequence[str]) -> int:
    """Run one command line; returns the exit code and never raises for user input."""
    remember(arguments)
    arguments = list(_spread_lists(_spread_settings(arguments))) or ["--help"]
    try:
        result = get_command(app).main(args=arguments, prog_name="lndrl", standalone_mode=False)
    except UserError as error:
        return _refuse("lndrl", str(error))
    except typer.TyperException as error:
        command = getattr(getattr(error, "ctx", None), "command_path", "lndrl")
        if not (words := error.format_message()):  # of a group without a command: its help is shown
            return 2
        return _refuse(command, words)
    except (KeyboardInterrupt, typer.Abort):
        return 128 + signal.SIGINT
    except RuntimeError as error:
        if not str(error).startswith(_NUMBA_HAS_NO_PLACE):
            raise
        return _refuse("lndrl", NOWHERE)
    return result if isinstance(result, int) else 0


def main() -> None:
    """Entry point of the console script."""
    _replace_what_cannot_be_written()
    received: list[int] = []

    def interrupt(number: int, frame: object) -> None:
        # SIGTERM and SIGHUP take the way of Ctrl-C, so that all clean up after themselves. A closed
        # terminal is told twice, and the second time must not disturb that.
        if number != signal.SIGHUP or not received:
            received.append(number)
            raise KeyboardInterrupt

    # Processes that are started from here look for modules where this one does; Python would look
    # in the working folder first, which may hold a learner.py of the user's.
    os.environ["PYTHONSAFEPATH"] = "1"
    limit_threads()
    with stop_handler(interrupt):
        code = run(sys.argv[1:])
    sys.exit(128 + received[0] if received and code == 128 + signal.SIGINT else code)


def _replace_what_cannot_be_written() -> None:
    """Let characters that the terminal's encoding lacks become question marks, not a traceback.

    Half bytes of a file's name, which no encoding has, too.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _spread_settings(arguments: Sequence[str]) -> Iterator[str]:
    """``--set a=1 b=2`` as ``--set a=1 --set b=2``."""
    after_set = False
    for position, argument in enumerate(arguments):
        is_setting = _SETTING.match(argument) is not None
        if after_set and is_setting and arguments[position - 1] != "--set":
            yield "--set"
        after_set = argument == "--set" or (after_set and is_setting)
        yield argument


def _spread_lists(arguments: Iterable[str]) -> Iterator[str]:
    """``certs --host a b`` as ``certs --host a --host b``."""
    given = list(arguments)
    option = None
    for position, argument in enumerate(given):
        if argument.startswith("-"):
            option = argument if given[0] == "certs" and argument in _LISTS else None
        elif option is not None and given[position - 1] != option:
            yield option
        yield argument


def _refuse(speaker: str, message: str) -> int:
    print(f"{speaker}: {' '.join(message.split())}", file=sys.stderr)
    return 2
