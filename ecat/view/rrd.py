"""A session as a file for the Rerun viewer (``.rrd``), blueprint included: what ``ecat view`` shows, to pass on.

Carried: everything that the view draws.  Left behind: what it thins out (the export says so), and time to come: Rerun
reads files of its own and of one earlier minor version, so this is a way of showing, not of keeping.  The same session
gives the same data, but not the same bytes: Rerun numbers its chunks at random.
"""

from __future__ import annotations

from pathlib import Path

from ecat.formats.format import Format
from ecat.formats.options import NoOptions
from ecat.progress import Progress
from ecat.store import Session


def part(session: Session, label: str, dest: Path, options: NoOptions, progress: Progress) -> tuple[str, ...]:
    """Write the recording; errors as of :func:`ecat.view.record.save_rrd`."""
    del label, options
    from ecat.view.record import save_rrd

    return save_rrd(session, dest, progress=progress)


FORMAT = Format(
    name="rrd",
    description="the view as a file for Rerun (.rrd), for viewers of this and the next minor version",
    part=part,
    suffix=".rrd",
)
