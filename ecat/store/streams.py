"""Files that are added to a session, and taken out of it again."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, count
from pathlib import Path

from ecat.errors import UsageError
from ecat.model import Stream
from ecat.store import files
from ecat.store.manifest import is_file_name
from ecat.store.session import Session


def add_file(session: Session, source: Path) -> Stream:
    """Copy a file into the session, which lists it from now on.

    Raises
    ------
    UsageError : its name cannot be that of a file everywhere.
    StoreError : it cannot be read, or the session not written; nothing was changed.
    """
    if not is_file_name(source.name):
        where = f"{source.name!r:.80} is no name that a file can have everywhere"
        raise UsageError(
            f"cannot add {source}", where=where, fix="rename it: letters, digits, '_', '-' and '.'"
        )
    name = next(name for name in _names(source) if _is_free(session, name))
    stream = Stream(name=name, file=f"media/{name}", present=True)
    with files.typed_errors(f"cannot add {source}", source, "nothing was changed"), session.write() as commit:
        commit.update(streams=(*session.manifest.streams, stream))
        commit.copy_streams({name: source})
    return session.stream(name)


def _names(source: Path) -> Iterator[str]:
    return chain([source.name], (f"{source.stem}_{number}{source.suffix}" for number in count(2)))


def _is_free(session: Session, name: str) -> bool:
    file = f"media/{name}"
    taken = {stream.file.lower() for stream in session.manifest.streams}
    there = (session.path / file).exists() or (session.path / file).is_symlink()
    return not there and file.lower() not in taken and all(s.name != name for s in session.manifest.streams)


def remove_file(session: Session, name: str) -> Stream:
    """Take a file out of the session that was not recorded: nothing is counted or computed by it.

    Raises
    ------
    NotFoundError : the session has no such stream.
    UsageError : it is a recording, or objects are drawn in it.
    StoreError : the session cannot be written; nothing was changed.
    """
    stream, what = session.stream(name), f"cannot remove {name}"
    if stream.kind not in {"other", "skeleton"}:
        raise UsageError(
            what,
            where=f"it is a recording ({stream.kind}): times, tables and annotations refer to it",
            fix="import the recording again without it: ecat import RECORDING NEW_FOLDER",
        )
    for record in session.manifest.layers:
        if drawn := [thing.id for thing in session.layer(record.name).objects if thing.stream == name]:
            raise UsageError(
                what,
                where=f"layer {record.name}: {', '.join(drawn[:5])} {'is' if len(drawn) == 1 else 'are'} drawn in it",
                fix=f"ecat object edit MY_SESSION {drawn[0]} --stream ANOTHER",
            )
    others = tuple(other for other in session.manifest.streams if other.name != name)
    with session.write() as commit:
        commit.update(streams=others)
    if stream.present and all(other.file != stream.file for other in others):
        path = files.confined(session.path, stream.file)
        with files.typed_errors(what, path, f"{name} is not listed any more, but its file is still there"):
            files.remove(path)
    return stream
