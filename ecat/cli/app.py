"""The ``ecat`` program: finds the verb, runs it, turns whatever goes wrong into one message and an exit code.

Exit codes: 0 done, 1 bad input (or findings that are errors), 2 wrong usage, 3 a bug of ecat,
130 interrupted, 141 whoever read the output went away.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING

import click

from ecat.cli.output import BROKEN_PIPE, print_bug, print_error
from ecat.cli.verb import EVERYWHERE, SETTINGS, after_the_verb, write_examples
from ecat.errors import EcatError, MissingExtraError, UsageError, os_error

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

INTERRUPTED = 130
BUG = 3

VERBS = (
    "project",
    "import",
    "info",
    "file",
    "box",
    "process",
    "calibrate",
    "check",
    "view",
    "annotate",
    "object",
    "event",
    "relation",
    "proposal",
    "scheme",
    "apply",
    "undo",
    "redo",
    "log",
    "restore",
    "survey",
    "agree",
    "stats",
    "query",
    "export",
    "sample",
    "formats",
    "demo",
)
"""In the order of ``ecat --help``: the order in which a recording meets them."""

EXAMPLES = (
    "ecat demo",
    "ecat import recording/ my_session",
    "ecat process my_session",
    "ecat view my_session",
)


class Verbs(click.Group):
    """The verbs, each imported when asked for; other packages add theirs as entry points of ``ecat.cli``."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click does, but what every verb takes may also stand before the verb."""
        if args and set(args) <= set(EVERYWHERE):
            ctx.fail(f"missing verb after {args[-1]}")
        return super().parse_args(ctx, after_the_verb(args))

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all verbs, our own first."""
        del ctx
        return [*VERBS, *sorted(set(_plugins()) - set(VERBS))]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The verb ``cmd_name``, or None."""
        del ctx
        if cmd_name in VERBS:
            # `import` is a keyword, so its module cannot be named so
            module = import_module(f"ecat.cli.{cmd_name}" + ("_" if cmd_name == "import" else ""))
            return module.command
        plugin = _plugins().get(cmd_name)
        return None if plugin is None else _load(plugin)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The first things to type."""
        del ctx
        write_examples(formatter, EXAMPLES)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does, but suggest the nearest verb."""
        try:
            return super().resolve_command(ctx, args)
        except click.NoSuchCommand as error:
            names = self.list_commands(ctx)
            raise click.NoSuchCommand(error.command_name, possibilities=names, ctx=ctx) from None


def _plugins() -> dict[str, EntryPoint]:
    from importlib.metadata import entry_points

    return {point.name: point for point in entry_points(group="ecat.cli")}


def _load(plugin: EntryPoint) -> click.Command:
    """The verb of another package; one that cannot be imported says so only when it is used."""
    try:
        return plugin.load()
    except ImportError as error:
        reason = str(error)

        def refuse() -> None:
            raise MissingExtraError(
                f"cannot load the verb {plugin.name}",
                where=f"{plugin.value}: {reason}",
                fix=f"install what it needs, for instance: pip install 'ecat[{plugin.name}]'",
            )

        return click.Command(
            plugin.name,
            callback=refuse,
            short_help=f"(not installed: {reason})",
            context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
        )


@click.group(cls=Verbs, context_settings=SETTINGS)
@click.version_option(None, "-V", "--version", package_name="ecat", message="ecat %(version)s")
def app() -> None:
    """Turn recordings of people handling objects into machine-learnable data.

    A session is one recording in a folder of its own; a project is a folder of sessions, a workspace a folder
    of projects.  Every verb takes --json (one JSON document on stdout), --quiet and --help, before or after
    the verb.
    """


def main(args: Sequence[str] | None = None) -> int:
    """Run ``ecat`` with ``args`` (the command line's if None) and return the exit code."""
    argv = list(sys.argv[1:] if args is None else args) or ["--help"]
    as_json = "--json" in argv
    for stream in (sys.stdout, sys.stderr):
        if reconfigure := getattr(stream, "reconfigure", None):  # names that the terminal cannot show
            reconfigure(errors="backslashreplace")
    try:
        code = _run(argv)
        sys.stdout.flush()
    except BrokenPipeError:
        _discard_stdout()
        return BROKEN_PIPE
    except click.Abort:
        print_error(EcatError("interrupted"), as_json=as_json)
        return INTERRUPTED
    except EcatError as error:
        print_error(error, as_json=as_json)
        return error.exit_code
    except Exception as error:  # noqa: BLE001  the last line of defence
        print_bug(error, as_json=as_json)
        return BUG
    return code


def _run(argv: list[str]) -> int:
    try:
        result: object = app.main(argv, prog_name="ecat", standalone_mode=False)
    except click.ClickException as error:
        context = getattr(error, "ctx", None) or click.Context(app, info_name="ecat")
        called, usage = context.command_path, " ".join(context.get_usage().split())
        message = error.format_message().rstrip(".")
        what = message[:1].lower() + message[1:]
        raise UsageError(what, where=usage, fix=f"{called} --help") from error
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            raise
        place, consequence = error.filename or "a file that is open", "what was finished before is kept"
        raise os_error(error, "cannot finish", place, consequence) from error
    return result if isinstance(result, int) else 0


def _discard_stdout() -> None:
    """Keep the interpreter from flushing into the closed pipe once more as it ends."""
    import os

    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
