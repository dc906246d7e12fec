"""``python -m ecat.cli.reference`` prints ``docs/cli.md`` from the help texts."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import click

from ecat.cli.app import VERBS, app
from ecat.cli.verb import SETTINGS, Group

WIDTH = 100
INTRODUCTION = """\
# The command line

Made from the help texts by `python -m ecat.cli.reference`; do not edit.

Every verb prints its result on stdout and everything else on stderr.  With `--json` the result, or the error,
is one JSON document on stdout with the field `ok`.  An error says what could not be done, where the cause is,
what happened to the data and what to try:

```
ecat: cannot create my_session
  my_session: there is something already
  it was left as it is
  try: choose another destination, or remove it first
```

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | bad input, or findings that are errors |
| 2 | wrong usage |
| 3 | a bug of ecat: the traceback is on stderr |
| 130 | interrupted with Ctrl-C |
| 141 | whoever read the output went away |
"""


def reference() -> str:
    """The reference of the whole command line as Markdown."""
    root = click.Context(app, info_name="ecat", terminal_width=WIDTH, **SETTINGS)
    sections = [INTRODUCTION, _section("ecat", root)]
    for name in VERBS:
        command = app.get_command(root, name)
        assert command is not None
        sections += _sections(command, name, root)
    return "\n".join(sections)


def _sections(command: click.Command, name: str, parent: click.Context) -> Iterator[str]:
    context = click.Context(command, info_name=name, parent=parent, terminal_width=WIDTH, **SETTINGS)
    yield _section(context.command_path, context)
    if isinstance(command, Group):
        for inner in command.list_commands(context):
            yield from _sections(command.commands[inner], inner, context)


def _section(title: str, context: click.Context) -> str:
    text = "\n".join(line.rstrip() for line in context.get_help().splitlines())
    return f"## {title}\n\n```\n{text}\n```\n"


if __name__ == "__main__":
    sys.stdout.write(reference())
