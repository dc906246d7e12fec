"""``ecat project``: folders of sessions that have coding schemes and surveys in common."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.text import shell
from ecat.cli.verb import Group, verb


@verb("new", examples=("ecat project new my_project",))
@click.argument("path", type=click.Path(path_type=Path), help="The folder to make.")
def new(out: Output, path: Path) -> None:
    """Make an empty project.

    A project is a folder of sessions; they can use the coding schemes beside its project.json and name objects of each
    other.
    """
    from ecat.model import ProjectManifest
    from ecat.store import create_project
    from ecat.store.manifest import require_utf8

    name = path.resolve().name
    require_utf8(f"cannot make {path}", name)
    created = datetime.now(UTC).isoformat(timespec="seconds")
    made = create_project(path, ProjectManifest(name=name, created=created))
    text = f"made {made.path}\ntry: {shell('ecat', 'import', 'YOUR_RECORDING', str(path / 'my_session'))}"
    out.result({"path": str(made.path), "name": name}, text)


command = Group(
    "project",
    [new],
    """Make projects.

    Sessions are folders of a project: one is added by importing it there (`ecat import RECORDING my_project/NAME`), and
    moved, copied or removed as any folder; `ecat check my_project` says which others then miss it.
    """,
    examples=("ecat project new my_project",),
)
