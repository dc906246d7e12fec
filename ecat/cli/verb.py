"""What all verbs share: ``--json``, ``--quiet``, and a help text that ends with examples."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from functools import wraps
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import BROKEN_PIPE, Output
from ecat.errors import UsageError

SETTINGS: dict[str, Any] = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


EVERYWHERE = ("--json", "--quiet", "-q")
"""What every verb takes, and may also stand before it."""


def after_the_verb(args: list[str]) -> list[str]:
    """``args`` with what every verb takes moved from before the verb to behind it."""
    early = list(takewhile(EVERYWHERE.__contains__, args))
    rest = args[len(early) :]
    return [*rest[:1], *early, *rest[1:]] if rest else args


def write_examples(formatter: click.HelpFormatter, examples: tuple[str, ...]) -> None:
    """Commands as they are typed, one a line."""
    with formatter.section("Examples"):
        for line in examples:
            formatter.write(f"{' ' * formatter.current_indent}{line}\n")


# click 8.5.0 does not know yet of what its paths are
_ClickPath = click.Path[Path] if TYPE_CHECKING else click.Path


class LocalPath(_ClickPath):
    """A path, and no URL, of which a path would lose a slash."""

    def coerce_path_result(self, value: Any) -> Path:
        """As click does.

        Raises
        ------
        UsageError : it is a URL.
        """
        if "://" in str(value):
            raise UsageError(
                f"cannot use {value} here",
                where="it is a URL; only info, view, stats, query and export read from one, and export writes to one",
                fix="read a copy in a folder of this machine, or write there and copy it to the URL then",
            )
        return super().coerce_path_result(value)


class Verb(click.Command):
    """A command with examples, whose paths are :class:`LocalPath`."""

    examples: tuple[str, ...] = ()

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        for parameter in self.params:
            if isinstance(given := parameter.type, click.Path):
                parameter.type = LocalPath(
                    exists=given.exists,
                    file_okay=given.file_okay,
                    dir_okay=given.dir_okay,
                    allow_dash=given.allow_dash,
                    path_type=Path,
                )

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The examples."""
        del ctx
        write_examples(formatter, self.examples)


class Group(click.Group):
    """Verbs that belong together (``ecat event add``, ``ecat event remove``), with examples of the whole."""

    def __init__(self, name: str, verbs: Sequence[Verb], text: str, *, examples: tuple[str, ...]) -> None:
        super().__init__(
            name,
            {str(verb.name): verb for verb in verbs},
            help=inspect.cleandoc(text),
            context_settings=SETTINGS,
        )
        self.examples = examples

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click does, but what every verb takes may also stand before the verb."""
        return super().parse_args(ctx, after_the_verb(args))

    def list_commands(self, ctx: click.Context) -> list[str]:
        """In the order given."""
        del ctx
        return list(self.commands)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The examples."""
        del ctx
        write_examples(formatter, self.examples)


def leaves(command: click.Command, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Verb | Group]]:
    """A verb with its path (``("event", "add")``), or a group of verbs and each of them."""
    if isinstance(command, Verb | Group):
        yield path, command
    if isinstance(command, Group):
        for name, inner in command.commands.items():
            yield from leaves(inner, (*path, name))


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
