"""What all verbs share: ``--json``, ``--quiet``, and a help text that ends with examples."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import click

from ecat.cli.output import BROKEN_PIPE, Output

SETTINGS: dict[str, Any] = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


def write_examples(formatter: click.HelpFormatter, examples: tuple[str, ...]) -> None:
    """Commands as they are typed, one a line."""
    with formatter.section("Examples"):
        for line in examples:
            formatter.write(f"{' ' * formatter.current_indent}{line}\n")


class Verb(click.Command):
    """A command with examples."""

    examples: tuple[str, ...] = ()

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The examples."""
        del ctx
        write_examples(formatter, self.examples)


def verb(name: str, *, examples: tuple[str, ...]) -> Callable[[Callable[..., int | None]], Verb]:
    """Make a command of a function ``run(out, ...)`` that returns its exit code, or None for 0.

    The first paragraph of its docstring is the short help.  Results go to ``out``; what goes wrong is raised.
    """

    def make(run: Callable[..., int | None]) -> Verb:
        @click.command(name, cls=Verb, context_settings=SETTINGS)
        @click.option("--json", "as_json", is_flag=True, help="Print one JSON document instead of text.")
        @click.option("--quiet", "-q", is_flag=True, help="Print neither progress nor result, only errors.")
        @wraps(run)
        def call(*, as_json: bool, quiet: bool, **arguments: Any) -> int:
            try:
                return run(Output(as_json=as_json, quiet=quiet), **arguments) or 0
            except BrokenPipeError:
                raise click.exceptions.Exit(BROKEN_PIPE) from None

        call.examples = examples
        return call

    return make
