"""Pages about the command line, from the commands themselves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer

from docs.site.reference.text import code, plain, said, table
from lndrl.cli.help import EXAMPLES, EXIT_CODES
from lndrl.cli.help.examples import example_lines
from lndrl.cli.main import ROOMS, SUMMARIES, load_command

PAGES = {
    "training": ("Training", ROOMS["training"]),
    "fleet": ("Several machines", ROOMS["fleet"]),
    "evaluation": ("Evaluation", (*ROOMS["evaluation"], *ROOMS["evaluation.bench"], "report")),
    "robot": ("Robots", (*ROOMS["robot"], "export")),
}
"""Page to its title and commands; whatever is in none of them stands on the last."""


def command_pages() -> dict[str, str]:
    """An overview, and a page for each room of commands."""
    placed = {name for _, names in PAGES.values() for name in names}
    rest = tuple(name for name in SUMMARIES if name not in placed)
    chosen = {**PAGES, "other": ("Configurations, machine, versions", rest)}
    pages = {"commands.md": _overview(chosen)}
    for page, (title, names) in chosen.items():
        ordered = [name for name in SUMMARIES if name in names]
        body = "\n\n".join(_command(name, load_command(name), 2) for name in ordered)
        pages[f"commands-{page}.md"] = f"# Commands: {title.lower()}\n\n{body}\n"
    return pages


def paths() -> Iterator[tuple[str, Any]]:
    """Every command and subcommand by its words, e.g. ``config show``."""

    def below(words: str, command: Any) -> Iterator[tuple[str, Any]]:
        yield words, command
        for name, inner in getattr(command, "commands", {}).items():
            yield from below(f"{words} {name}", inner)

    for name in SUMMARIES:
        yield from below(name, load_command(name))


def _overview(pages: dict[str, tuple[str, tuple[str, ...]]]) -> str:
    where = {name: page for page, (_, names) in pages.items() for name in names}
    rows = [
        (f"[{name}](commands-{where[name]}.md#{_anchor(name)})", plain(text))
        for name, text in SUMMARIES.items()
    ]
    codes = [(str(number), meaning) for number, meaning in EXIT_CODES.items()]
    return f"""# Commands

Every command says the same with `--help`. `lndrl --install-completion` completes commands, options,
names of configurations and keys in your shell.

{table(("command", "what it does"), rows)}

## Exit codes

Of all commands:

{table(("code", "meaning"), codes)}

What a user has to mend is one sentence on standard error and code 2; a traceback is a defect of
the program. What commands say beside their result (notes, progress) goes to standard error; with
`--json` standard output holds JSON alone.
"""


def _command(words: str, command: Any, level: int) -> str:
    context = typer.Context(command, info_name=f"lndrl {words}")
    arguments, options, usage = [], [], ["lndrl", words]
    for parameter in command.params:
        record = parameter.get_help_record(context)
        if record is None or parameter.name == "help":
            continue
        if parameter.param_type_name == "argument":
            name = parameter.metavar or parameter.name.upper()
            arguments.append((code(name), plain(record[1])))
            usage.append(name)
        else:
            options.append((code(record[0]), plain(record[1])))
    usage += ["COMMAND"] if hasattr(command, "commands") else []
    usage += ["[OPTIONS]"] if options else []
    parts = [
        f"{'#' * level} {words}",
        plain(said(command.help)),
        f"```text\n{' '.join(usage)}\n```",
    ]
    if arguments:
        parts.append(table(("argument", ""), arguments))
    if options:
        parts.append(table(("option", ""), options))
    examples = "\n".join(line[2:] for line in example_lines(EXAMPLES[words]))
    parts.append(f"```sh\n{examples}\n```")
    for name, inner in getattr(command, "commands", {}).items():
        parts.append(_command(f"{words} {name}", inner, level + 1))
    return "\n\n".join(parts)


def _anchor(name: str) -> str:
    return name.lower()
