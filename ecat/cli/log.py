"""``ecat log``: who edited what, and when."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.edit import author_option, editing, layer_option, path_argument
from ecat.cli.output import Output
from ecat.cli.text import columns
from ecat.cli.verb import verb

if TYPE_CHECKING:
    from ecat.annotate import Record


@verb(
    "log",
    examples=(
        "ecat log my_session",
        "ecat log my_session --layer ann --last 5",
        "ecat log my_session --json",
    ),
)
@path_argument
@layer_option
@author_option
@click.option("--last", type=click.IntRange(min=1), help="Only the newest edits.")
def command(out: Output, path: Path, layer: str, author: str | None, last: int | None) -> None:
    """List the edits of a layer, the newest last; `ecat restore` goes back to any of them."""
    with editing(path, layer, author) as editor:
        start = max(1, editor.revision - last + 1) if last else 1
        records = editor.history(start, editor.revision)
    rows = [
        [str(r.revision), r.time[:19].replace("T", " "), r.author, r.operation["op"], _rest(r)]
        for r in records
    ]
    out.result({"layer": layer, "records": [r.to_dict() for r in records]}, columns(rows) or "no edits yet")


def _rest(record: Record) -> str:
    said: dict[str, Any] = {
        k: v for k, v in record.operation.items() if k != "op" and v not in (None, "", [], {})
    }
    text = " ".join(f"{name}={json.dumps(value, ensure_ascii=False)}" for name, value in said.items())
    return text if len(text) <= 100 else f"{text[:97]}..."
