"""``ecat apply``: edits from a file."""

from __future__ import annotations

import json
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from ecat.cli.edit import author_option, editing, layer_option, path_argument
from ecat.cli.output import Output
from ecat.cli.text import count
from ecat.cli.verb import verb
from ecat.errors import EcatError, FormatError

MAX_BYTES = 256 << 20


@verb(
    "apply",
    examples=(
        "ecat apply my_session edits.jsonl",
        "ecat apply my_session edits.jsonl --one-step --author ann",
        "ecat apply my_session -",
    ),
)
@path_argument
@click.argument(
    "source",
    type=click.Path(path_type=Path, allow_dash=True),
    help="Operations as JSON, one a line or a list; - is stdin.",
)
@layer_option
@author_option
@click.option("--one-step", is_flag=True, help="All or none of them, and one step for undo.")
def command(out: Output, path: Path, source: Path, layer: str, author: str | None, *, one_step: bool) -> None:
    """Make the edits that a file lists: operations as `ecat log --json` shows them.

    They are made one after the other, until one is refused; those before it stay.  For example:

    \b
    {"op": "add_event", "type": "slide", "segments": [[120, 180]], "roles": {"Theme": "o1"}}
    {"op": "move_edge", "id": "a1", "segment": 0, "edge": "end", "frame": 184}
    """  # noqa: D301  click wants the backspace itself
    from ecat.annotate import operations_from_list

    asked = _read(source)
    with _placed(f"{source}"):
        operations = operations_from_list(asked)
    with editing(path, layer, author, new=True) as editor, out.progress() as progress:
        if one_step and operations:
            with _placed(f"{source}"):
                editor.apply(operations)
        for done, operation in enumerate([] if one_step else operations):
            progress("editing", done, len(operations))
            with _placed(f"{source}: operation {done + 1} of {len(operations)}", done):
                editor.apply(operation)
        data = {"layer": layer, "applied": len(operations), "revision": editor.revision}
    out.result(data, f"{count(len(operations), 'operation')}, revision {data['revision']} of layer {layer}")


@contextmanager
def _placed(where: str, done: int = 0) -> Generator[None]:
    """Say in errors which operation was refused, and what became of the ``done`` ones before it."""
    try:
        yield
    except EcatError as error:
        error.where = f"{where}\n{error.where}"
        if done:
            error.consequence = f"the {count(done, 'operation')} before it stay, and nothing else was changed"
        raise


def _read(source: Path) -> list[Any]:
    from ecat.store import files

    if str(source) == "-":
        data = sys.stdin.buffer.read(MAX_BYTES)
    else:
        with files.typed_errors(f"cannot read {source.name}", source):
            data = files.read_bytes(source, MAX_BYTES)
    try:
        return _objects(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FormatError(
            f"cannot read {source.name}",
            where=f"{source}: not JSON: {error}",
            consequence="nothing was changed",
            fix='write a line for each operation: {"op": "add_event", ...}',
        ) from None


def _objects(text: str) -> list[Any]:
    whole = text.lstrip().startswith("[")
    found = json.loads(text) if whole else [json.loads(line) for line in text.splitlines() if line.strip()]
    if not all(isinstance(item, dict) for item in found):
        raise ValueError("an operation is an object in braces")
    return found
