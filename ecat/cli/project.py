"""``ecat project``: folders of sessions that have coding schemes and surveys in common."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import click

from ecat.cli.output import Output
from ecat.cli.text import columns, shell
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


@verb(
    "remove",
    examples=("ecat project remove my_project my_project/slide", "ecat project remove p p/s --for-good"),
)
@click.argument("project", type=click.Path(path_type=Path), help="The project.")
@click.argument("session", type=click.Path(path_type=Path), help="The folder of the session.")
@click.option("--for-good", is_flag=True, help="Delete it, instead of putting it into the archive.")
def remove(out: Output, project: Path, session: Path, for_good: bool) -> None:
    """Take a session out of a project, into its archive (the folder .archive of the project)."""
    from ecat.store import archive, open_session

    open_session(session)
    name = archive.put_away(project, session)
    if for_good:
        archive.delete(project, name, session.resolve().name)
    way_back = f"\ntry: {shell('ecat', 'project', 'restore', str(project), name)} brings it back"
    text = f"deleted {session}" if for_good else f"archived {session} as {name}{way_back}"
    out.result({"session": str(session), "archived": None if for_good else name}, text)


@verb("archive", examples=("ecat project archive my_project",))
@click.argument("project", type=click.Path(path_type=Path), help="The project.")
def list_archive(out: Output, project: Path) -> None:
    """List the sessions that were put away, the newest first."""
    from ecat.store import archive

    found = archive.archived(project)
    rows = [[one.id, one.place.as_posix(), one.when] for one in found]
    data = [{"id": one.id, "place": one.place.as_posix(), "when": one.when} for one in found]
    out.result({"archived": data}, columns(rows) if rows else "the archive is empty")


@verb(
    "restore",
    examples=(
        "ecat project restore my_project 20260102T120000-0a1b2c",
        "ecat project restore my_project 20260102T120000-0a1b2c --delete slide",
    ),
)
@click.argument("project", type=click.Path(path_type=Path), help="The project.")
@click.argument("name", help="What it is called in the archive, see `ecat project archive`.")
@click.option("--delete", "said", metavar="SESSION", help="Delete it for good instead; its name, to confirm.")
def restore(out: Output, project: Path, name: str, said: str | None) -> None:
    """Bring an archived session back to where it was."""
    from ecat.store import archive

    if said is not None:
        archive.delete(project, name, said)
        out.result({"session": None}, f"deleted {said}")
        return
    place = archive.bring_back(project, name)
    out.result({"session": str(place)}, f"{place} is back")


command = Group(
    "project",
    [new, remove, list_archive, restore],
    """Make projects, and put sessions of them away.

    Sessions are folders of a project: one is added by importing it there (`ecat import RECORDING my_project/NAME`), and
    moved or copied as any folder; `ecat check my_project` says which others then miss it.
    """,
    examples=("ecat project new my_project", "ecat project remove my_project my_project/slide"),
)
