"""``python -m ecat.cli.reference`` prints ``docs/cli.md`` from the help texts.

``python -m ecat.cli.reference README.md`` writes its table of formats anew, from the registry and ``docs/formats``.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import click

from ecat.cli.app import app
from ecat.cli.verb import SETTINGS, Group
from ecat.formats import registry

WIDTH = 100
BEGIN, END = "<!-- formats: written by make docs -->\n", "<!-- end of formats -->"
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
    for name in app.list_commands(root):
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


def with_formats(readme: str, docs: Path) -> str:
    """The text of the README with the table of formats as the registry has it.

    Parameters
    ----------
    docs : the folder of the pages, one of which has each format in a heading or in front of a row of a table.
    """
    head, _, rest = readme.partition(BEGIN)
    _, _, tail = rest.partition(END)
    # other pages have tables of options, which may be called as a recording is
    paths = sorted(docs.glob("*.md"), key=lambda path: (path.stem != "recordings", path.name))
    pages = {path.name: path.read_text("utf-8") for path in paths}
    mark = {True: "yes", False: ""}
    lines = ["| format | reads | writes | what it is |", "|---|---|---|---|"]
    for known in sorted(registry.all_formats(), key=lambda known: known.name):
        link = f"[{known.name}](docs/formats/{page_of(known.name, pages)})"
        lines.append(f"| {link} | {mark[known.reads]} | {mark[known.writes]} | {known.description} |")
    return "\n".join([f"{head}{BEGIN}", *lines, f"{END}{tail}"])


def page_of(name: str, pages: Mapping[str, str]) -> str:
    """The page that explains the format of this name.

    Raises
    ------
    LookupError : there is none.
    """
    place = re.compile(rf"^(#.*[ ,]{re.escape(name)}(?![\w-])|\| `{re.escape(name)}`)", re.MULTILINE)
    for page, text in pages.items():
        if place.search(text):
            return page
    raise LookupError(f"no page in docs/formats explains {name}")


def main(path: str = "") -> None:
    """Print the reference, or write the README at ``path`` anew."""
    if not path:
        sys.stdout.write(reference())
        return
    readme = Path(path)
    readme.write_text(with_formats(readme.read_text("utf-8"), readme.parent / "docs" / "formats"), "utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
