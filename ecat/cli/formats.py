"""``ecat formats``: what can be read and written."""

from __future__ import annotations

from ecat.cli.output import Output
from ecat.cli.text import columns
from ecat.cli.verb import verb


@verb("formats", examples=("ecat formats", "ecat formats --json"))
def command(out: Output) -> None:
    """List the formats that can be imported and exported."""
    from ecat.formats import registry

    found = sorted(registry.all_formats(), key=lambda known: known.name)
    rows = [[f.name, "import" if f.reads else "", "export" if f.writes else "", f.description] for f in found]
    data = {
        "formats": [
            {"name": f.name, "reads": f.reads, "writes": f.writes, "description": f.description}
            for f in found
        ]
    }
    out.result(data, columns(rows))
