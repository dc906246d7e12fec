"""``ecat calibrate``: sizes and markers of boxes, from recordings of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ecat.cli.output import Output
from ecat.cli.text import columns
from ecat.cli.verb import verb

if TYPE_CHECKING:
    from ecat.model.prototype import BoxPrototype


@verb(
    "calibrate",
    examples=("ecat calibrate my_project -o boxes.json", "ecat calibrate session_1 session_2 -o boxes.json"),
)
@click.argument(
    "paths",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
    help="Sessions, projects or workspaces.",
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The JSON file to write.",
)
def command(out: Output, paths: tuple[Path, ...], output: Path) -> None:
    """Measure boxes from recordings: their sizes, and which marker sits where.

    All recordings together; they must be of the same boxes and by the same camera.  The file is for
    `ecat process --prototypes`.
    """
    from ecat import process
    from ecat.cli.describe import sessions_at

    sessions = [session for path in paths for session in sessions_at(path)]
    with out.progress() as progress:
        boxes = process.calibrate(sessions, progress)
    process.write_prototypes(output, boxes)
    rows = [[box.name, _size(box), f"{len(box.faces)} markers"] for box in boxes]
    data = {"file": str(output), "boxes": [box.to_dict() for box in boxes]}
    out.result(data, f"{columns(rows)}\nwrote {output}; try: ecat process --prototypes {output} ...")


def _size(box: BoxPrototype) -> str:
    return " x ".join(f"{edge:.4f}" for edge in box.size_m) + " m"
