"""Taking what the journals say over into the XML and the tables of the annotations."""

from __future__ import annotations

import contextlib

from ecat.errors import EcatError, InputError
from ecat.model import Layer, LayerRecord
from ecat.model.document import Document
from ecat.store.commit import Commit
from ecat.store.journal import Journal, Place
from ecat.store.lock import locked
from ecat.store.manifest import journal_file
from ecat.store.snapshot import Snapshot
from ecat.store.transaction import NewFiles, new_id, roll_forward


def behind(snapshot: Snapshot) -> list[LayerRecord]:
    """The layers whose journal goes on behind what their XML contains; looks at the sizes of files only."""

    def size(record: LayerRecord) -> int:
        with contextlib.suppress(OSError):
            return (snapshot.path / journal_file(record.name)).stat().st_size
        return 0

    return [record for record in snapshot.manifest.layers if size(record) > record.journal_bytes]


def catch_up(snapshot: Snapshot) -> Snapshot:
    """The session with everything that its journals say, if somebody may write it now; else as it is."""
    if not behind(snapshot):
        return snapshot
    # whoever reads gets the last checkpoint, and ecat check says why
    with contextlib.suppress(EcatError), locked(snapshot.path):
        roll_forward(snapshot.path, f"cannot write to session {snapshot.path.name}")
        return fold(Snapshot.read(snapshot.path))
    return snapshot


def fold(snapshot: Snapshot) -> Snapshot:
    """Commit what the journals say beyond the XML; the caller holds the session's lock.

    A layer whose journal cannot be used is left as it is.
    """
    found: list[tuple[Layer, Place]] = []
    for record in behind(snapshot):
        with contextlib.suppress(EcatError):
            layer, place = current(snapshot, record)
            if place.revision > record.journal_revision:
                found.append((layer, place))
    return save(snapshot, found) if found else snapshot


def fold_if_possible(snapshot: Snapshot) -> Snapshot:
    """:func:`fold`, unless a layer has become one that cannot be written: that is no reason not to write others."""
    try:
        return fold(snapshot)
    except InputError:
        return snapshot


def save(snapshot: Snapshot, layers: list[tuple[Layer, Place]]) -> Snapshot:
    """Commit layers as they were at a place of their journal; the caller holds the session's lock."""
    new = NewFiles(snapshot.path, new_id())
    try:
        commit = Commit(new, snapshot.manifest, snapshot.layer)
        for layer, place in layers:
            commit.put_checkpoint(layer, place)
        with contextlib.ExitStack() as until_committed:
            commit.close(snapshot.manifest.revision + 1, until_committed)
            new.commit()
    except BaseException:
        new.discard()
        raise
    return Snapshot.read(snapshot.path)


def current(snapshot: Snapshot, record: LayerRecord) -> tuple[Layer, Place]:
    """A layer with everything that its journal says, and the place that this is.

    Raises
    ------
    CorruptError : the journal does not fit the layer, or its XML was edited outside of ecat.
    StaleError : a later commit has replaced the layer.
    """
    journal = Journal(snapshot.path, record.name)
    layer, place = snapshot.layer(record.name), Place(record.journal_revision, record.journal_bytes)
    if journal.size() < place.offset:
        raise journal.damaged(f"{journal.size()} bytes, but the XML contains {place.offset} of them")
    news = list(journal.records(place))
    if not news:
        return layer, place
    if not place.offset and journal.continues() != record.sha256:
        raise journal.damaged("it continues another layer than the XML")
    document = Document(layer)
    for record_, behind_ in news:
        journal.apply(document, record_)
        place = behind_
    return document.layer(), place
