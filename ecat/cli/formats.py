"""``ecat formats``: what can be read and written."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ecat.cli.output import Output
from ecat.cli.text import columns
from ecat.cli.verb import verb

if TYPE_CHECKING:
    from ecat.formats import Format


@verb("formats", examples=("ecat formats", "ecat formats lerobot", "ecat formats --json"))
@click.argument("name", required=False, help="The format to explain.")
def command(out: Output, name: str | None) -> None:
    """List the formats that can be imported and exported, or explain one with its options."""
    from ecat.formats import registry

    if name is not None:
        found = registry.find(name)
        out.result(_data(found), _explained(found))
        return
    known = sorted(registry.all_formats(), key=lambda known: known.name)
    rows = [[f.name, "import" if f.reads else "", "export" if f.writes else "", f.description] for f in known]
    out.result({"formats": [_data(f) for f in known]}, columns(rows))


def _data(known: Format) -> dict[str, object]:
    from dataclasses import asdict

    from ecat.formats.options import describe

    return {
        "name": known.name,
        "reads": known.reads,
        "writes": known.writes,
        "description": known.description,
        "options": [asdict(option) for option in describe(known.options)],
    }


def _explained(known: Format) -> str:
    from ecat.formats.options import describe

    can = " and ".join(
        ["import"] * (known.read is not None)
        + ["import into a session"] * (known.read_layer is not None)
        + ["export"] * known.writes
    )
    rows = [
        [f"  {o.name}", o.help, o.values, f"default: {o.default or 'nothing'}"]
        for o in describe(known.options)
    ]
    lines = [f"{known.name}: {known.description}", f"can be used for: {can or 'nothing'}"]
    if rows:
        lines += ["options, each given as --option NAME=VALUE:", columns(rows)]
    return "\n".join(lines)
