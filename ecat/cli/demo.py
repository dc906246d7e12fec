"""``ecat demo``: the whole way of a recording, from an old format to data and back."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.text import shell
from ecat.cli.verb import verb


@verb("demo", examples=("ecat demo", "ecat demo my_demo"))
@click.argument(
    "dest",
    type=click.Path(path_type=Path),
    default=Path("demo"),
    help="The folder to make; demo if not given.",
)
def command(out: Output, dest: Path) -> int:
    """Take a small recording all the way and show what there is to see.

    Imports a project in the format of 2018, says what is in it, runs every stage, checks it, exports the
    poses of the boxes and a recording for the Rerun viewer, and writes the project back byte for byte.  Then
    takes colour and depth video the same way, from pixels to poses and proposed events.  May be repeated: what
    an earlier demo made is made anew.
    """
    from ecat.cli.tour import tour

    made = tour(dest, out)
    session = made["session"]
    program = f"import ecat; print(ecat.open_session({json.dumps(session)}).poses.to_pandas())"
    steps = (
        shell("rerun", made["recording"]),
        shell("rerun", made["video_recording"]),
        shell("ecat", "info", session),
        shell("python", "-c", program),
        shell("ecat", "import", "YOUR_RECORDING", "my_session"),
    )
    out.result(made, "try: " + "\n     ".join(steps), ok=bool(made["identical"]))
    return 0 if made["identical"] else 1
