"""``ecat file``: files that go with a session, and skeletons that another program saved."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ecat.cli.edit import author_option, editing, layer_option, path_argument
from ecat.cli.output import Output
from ecat.cli.text import count
from ecat.cli.verb import Group, verb

if TYPE_CHECKING:
    from ecat.store import Session


@verb(
    "add",
    examples=(
        "ecat file add my_session rig_10_4_2017_10_35_30PM.xml",
        "ecat file add my_session consent.pdf",
    ),
)
@path_argument
@click.argument(
    "source",
    type=click.Path(path_type=Path),
    help="The file; a folder if a body scheme lies beside a rig file.",
)
@layer_option
@author_option
def add(out: Output, path: Path, source: Path, layer: str, author: str | None) -> None:
    """Copy a file into a session.

    Skeletons (a rig file of ECAT's recorder, or one of the NTU data set) become joints, and an object for each body, on
    the layer; anything else is kept as it is, and exported with the session where a format has a place for it.
    """
    from ecat.store import open_session

    session = open_session(path)
    if _has_skeletons(source):
        _add_skeletons(out, session, source, layer, author)
        return
    from ecat.store.streams import add_file

    stream = add_file(session, source)
    out.result(
        {"stream": stream.name, "file": stream.file, "objects": []}, f"added {stream.name} as {stream.file}"
    )


def _has_skeletons(source: Path) -> bool:
    from ecat.formats import registry
    from ecat.formats.recordings import ntu

    kind = registry.side_file(source) if source.is_file() else None
    return source.is_dir() or ntu.sniff(source) or (kind is not None and kind.name == "ecat-2018 rig")


def _add_skeletons(out: Output, session: Session, source: Path, layer: str, author: str | None) -> None:
    from ecat.annotate import operation_from_dict
    from ecat.errors import FormatError
    from ecat.formats.skeletons import add_operations, put_skeletons, read_skeletons

    found = read_skeletons(source, session)
    if not found.bodies:
        raise FormatError(
            f"cannot add {source}", where="not a single body in it", consequence="nothing was changed"
        )
    with editing(session.path, layer, author, new=True) as editor:
        record = editor.apply([operation_from_dict(said) for said in add_operations(found)])
        added = [change.id for change in record.changes if change.kind == "object"]
        try:
            put_skeletons(session.refresh(), found, dict(zip(found.bodies, added, strict=True)))
        except BaseException:
            editor.undo()
            raise
    stream = session.manifest.streams[-1]
    lines = [f"added object {name}" for name in added]
    lines += [*found.findings, f"added {stream.name}: {count(found.rows.num_rows, 'joint')}"]
    data = {"stream": stream.name, "file": stream.file, "objects": added, "findings": list(found.findings)}
    out.result(data, "\n".join(lines))


@verb("remove", examples=("ecat file remove my_session consent.pdf",))
@path_argument
@click.argument("name", help="The file's name in the session (`ecat info` lists them).")
def remove(out: Output, path: Path, name: str) -> None:
    """Take a file out of a session and delete it.

    What was recorded stays: times, tables and annotations refer to it.  The joints that were read from a file stay as
    well; `ecat object remove` removes their object.
    """
    from ecat.store import open_session
    from ecat.store.streams import remove_file

    stream = remove_file(open_session(path), name)
    out.result({"stream": stream.name, "file": stream.file}, f"removed {stream.name}")


command = Group(
    "file",
    [add, remove],
    "Add files to a session, skeletons among them, and remove them.",
    examples=(
        "ecat file add my_session rig_10_4_2017_10_35_30PM.xml",
        "ecat file remove my_session consent.pdf",
    ),
)
