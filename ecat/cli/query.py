"""``ecat query``: a question in SQL to all sessions of a project."""

from __future__ import annotations

import math
import sys
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from ecat.cli.output import Output
from ecat.cli.text import cell, columns, count
from ecat.cli.transfer import Place
from ecat.cli.verb import verb
from ecat.errors import UsageError

if TYPE_CHECKING:
    from ecat.query import Answer, TableHelp

_PLAN = ["explain_key", "explain_value"]
"""Columns of what EXPLAIN answers."""


@verb(
    "query",
    examples=(
        "ecat query my_project --tables",
        'ecat query my_project "select type, count(*) from events group by type"',
        'ecat query my_project "select session, avg(sigma_m) from poses group by session" --to sigma.csv',
    ),
)
@click.argument("path", type=Place(), help="A session, project or workspace; also a URL (s3://...).")
@click.argument("question", required=False, help="A SELECT, in DuckDB's SQL; - reads it from the input.")
@click.option("--tables", is_flag=True, help="List the tables and what their columns mean.")
@click.option(
    "--to", "dest", type=click.Path(path_type=Path), metavar="FILE", help="Write all rows: .parquet or .csv."
)
@click.option(
    "--rows",
    type=click.IntRange(min=0),
    default=50,
    show_default=True,
    help="How many rows to print.",
)
def command(
    out: Output, path: Path | str, question: str | None, tables: bool, dest: Path | None, rows: int
) -> int:
    """Ask all sessions of a project a question in SQL.

    Every table of the sessions is a table of the same name with the rows of all, and says in the column `session` which
    one a row is from; the table `sessions` has a row for each.  A question reads the sessions and nothing else, and
    changes nothing.
    """
    from ecat import query
    from ecat.store import remote

    if tables:
        with remote.all_at_hand(path) as folder:
            _list_tables(out, query.tables_at(folder))
        return 0
    if question is None:
        raise UsageError(
            "there is no question",
            where="expected a SELECT in quotes",
            fix=f"ecat query {path} 'select * from sessions'",  # noqa: S608  (a hint)
        )
    asked = sys.stdin.read() if question == "-" else question
    with (
        out.progress() as progress,
        remote.all_at_hand(path) as folder,
        query.open_database(folder, progress=progress) as database,
    ):
        answer = database.ask(asked)
        if dest is None:
            _print(out, answer, rows)
        else:
            n = query.write_answer(answer, dest)
            out.result({"path": str(dest), "rows": n}, f"wrote {count(n, 'row')} to {dest}")
        for session, error in database.failures:
            click.echo(f"{session} was not asked: {error}", err=True)
    return 1 if database.failures else 0


def _list_tables(out: Output, tables: list[TableHelp]) -> None:
    lines: list[str] = []
    for table in tables:
        lines.append(f"{table.name} ({count(table.rows, 'row')})")
        lines.append(columns([list(field) for field in table.columns], indent=2))
    data = [
        {
            "name": table.name,
            "rows": table.rows,
            "columns": [{"name": name, "meaning": meaning} for name, meaning in table.columns],
        }
        for table in tables
    ]
    out.result({"tables": data}, "\n".join(lines))


def _print(out: Output, answer: Answer, most: int) -> None:
    from ecat.query import rows_of

    rows: list[dict[str, Any]] = []
    more = False
    for batch in answer.batches:
        if more := len(rows) + batch.num_rows > most:
            rows += rows_of(batch.slice(0, most - len(rows)))
            break
        rows += rows_of(batch)
    names = answer.schema.names
    if names == _PLAN:  # drawn with characters, over many lines
        text = "\n".join(str(row[_PLAN[1]]).rstrip() for row in rows)
    else:
        lines = [names, *([_cell(row[name]) for name in names] for row in rows)]
        text = columns(lines) if names else ""
    if more:
        text += "\n... there are more rows: --rows prints more, --to FILE writes all"
    out.result({"rows": _jsonable(rows), "more": more}, text)


def _jsonable(value: Any) -> Any:
    """A value as JSON can have it: null for what is no number, numbers for decimals, a text for what else there is."""
    if isinstance(value, dict):
        return {str(key): _jsonable(inner) for key, inner in cast("dict[Any, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [_jsonable(inner) for inner in cast("list[Any]", value)]
    if isinstance(value, Decimal):
        return int(value) if value == value.to_integral_value() else float(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)


def _cell(value: Any) -> str:
    return cell("" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value))
