"""``ecat view``: a session in the Rerun viewer, or as a recording for it."""

from __future__ import annotations

from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.text import shell
from ecat.cli.transfer import Place
from ecat.cli.verb import verb


@verb("view", examples=("ecat view my_session", "ecat view my_session --save my_session.rrd"))
@click.argument("session", type=Place(), help="The session to show; also a URL (s3://...).")
@click.option(
    "--save", type=click.Path(path_type=Path), metavar="FILE.rrd", help="Write a recording instead."
)
def command(out: Output, session: Path | str, save: Path | None) -> None:
    """Show a session in the Rerun viewer.

    Images, markers, boxes, table and skeletons in space, events and relations on the same timeline.
    """
    from ecat import store, view
    from ecat.store import remote

    with out.progress() as progress, remote.at_hand(session) as folder:
        opened = store.open_session(folder)
        if save is None:
            findings = view.open_viewer(opened, progress=progress)
        else:
            findings = view.save_rrd(opened, save, progress=progress)
    data = {"session": opened.name, "file": None if save is None else str(save), "findings": list(findings)}
    done = f"showing {opened.name}" if save is None else f"wrote {save}"
    follow_up = [] if save is None else [f"try: {shell('rerun', save)}"]
    out.result(data, "\n".join([done, *(f"  {finding}" for finding in findings), *follow_up]))
