"""What every command says beside its own: examples, exit codes, and what may come next."""

from lndrl.cli.help.examples import EXAMPLES, Example, with_examples
from lndrl.cli.help.exits import EXIT_CODES, exit_code_lines
from lndrl.cli.help.following import say_next

__all__ = [
    "EXAMPLES",
    "EXIT_CODES",
    "Example",
    "exit_code_lines",
    "say_next",
    "with_examples",
]
