"""What is acknowledged can be saved: a layer does not grow beyond what can be read again."""

from __future__ import annotations

import pytest

from ecat.annotate import Editor, room
from ecat.errors import LimitError
from ecat.store import Session, open_session, xml
from tests.annotate.bench import do, op


def test_a_step_that_makes_the_layer_too_large_is_refused_and_the_rest_is_saved(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (xml, room):
        monkeypatch.setattr(module, "MAX_BYTES", 60_000)
    with Editor(session, author="ann") as editor:
        # each of these characters is four bytes of XML
        long = op("add_event", segments=[[0, 1]], text="<" * 900)
        taken = 15
        for _ in range(taken):
            do(editor, long)
        with pytest.raises(LimitError, match="cannot write"):
            do(editor, long, long)
        assert len(editor.layer.events) == taken
        do(editor, op("remove_event", id="a1"))
        do(editor, op("add_event", segments=[[0, 1]], text="small"))
    assert len(open_session(session.path).layer("main").events) == taken


def test_what_others_added_counts_too(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (xml, room):
        monkeypatch.setattr(module, "MAX_BYTES", 20_000)
    with Editor(session, author="ann") as ann, Editor(open_session(session.path), author="ben") as ben:
        for _ in range(4):
            do(ann, op("add_event", segments=[[0, 1]], text="<" * 900))
        with pytest.raises(LimitError, match="cannot write"):
            do(ben, op("add_event", segments=[[0, 1]], text="<" * 1500))
