"""What anybody may send to an annotation, and what may have become of its journal."""

from __future__ import annotations

import json
import tempfile
from contextlib import suppress
from pathlib import Path
from random import Random

from ecat.annotate import Editor, operations_from_list
from ecat.annotate.operations import Edit
from ecat.annotate.rules import perform
from ecat.errors import EcatError
from ecat.model import Layer, Manifest
from ecat.model.changes import invert
from ecat.model.document import Document
from ecat.store import Draft, Journal, Session, create_session, open_session
from tests.annotate.anything import ANYTHING, BEGINNING, Chance

MANIFEST = Manifest(name="s", created="2024-01-01", n_frames=100)


def small_session(folder: str) -> Session:
    """A session of a hundred frames with an empty layer."""
    return create_session(Path(folder) / "s", Draft(manifest=MANIFEST, layers=(Layer(),)))


def operations(data: bytes) -> None:
    """Operations as JSON, on a layer with something in it; what is done can be undone."""
    document = Document(Layer())
    perform(Edit(document, n_frames=100), operations_from_list(BEGINNING))
    before = document.layer()
    try:
        asked = json.loads(data)
    except (ValueError, RecursionError):
        return
    if isinstance(asked, list) and all(isinstance(item, dict) for item in asked):
        changes = perform(Edit(document, n_frames=100), operations_from_list(asked))
        document.apply(invert(changes))
        assert document.layer() == before


def journal(data: bytes) -> None:
    """A journal: the session opens whatever is in it, and an editor says what is wrong."""
    with tempfile.TemporaryDirectory() as folder:
        path = small_session(folder).path
        (path / "annotations" / "main.journal.jsonl").write_bytes(data)
        open_session(path).layer()
        with suppress(EcatError):
            Editor(open_session(path)).save()
        open_session(path).layer()


def operation_seeds() -> tuple[bytes, ...]:
    """An operation of every kind that can be done to the layer by itself."""
    document = Document(Layer())
    perform(Edit(document, n_frames=100), operations_from_list(BEGINNING))
    possible: list[bytes] = []
    for name, said in ANYTHING.items():
        for seed in range(10):
            data = json.dumps([{"op": name, **said(Chance(Random(seed), document.layer()))}]).encode()
            with suppress(EcatError):
                operations(data)
                possible.append(data)
                break
    return tuple(possible)


def journal_seed() -> bytes:
    """A journal with a step and its undo."""
    with tempfile.TemporaryDirectory() as folder:
        editor = Editor(small_session(folder), author="ann")
        editor.apply(operations_from_list(BEGINNING))
        editor.undo()
        return Journal(editor.session.path, "main").path.read_bytes()
