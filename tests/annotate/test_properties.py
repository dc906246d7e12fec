"""Whatever is done, everything can be undone exactly, the journal tells the same, and no rule is broken."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.annotate import Editor
from ecat.errors import EcatError, OperationError
from ecat.model import Layer
from ecat.model.document import Document
from ecat.model.scheme import BLOCKS_SCHEME
from ecat.store import Draft, create_session, open_session, validate
from tests.annotate.anything import BEGINNING, MACHINE, OTHER, anything
from tests.annotate.bench import MANIFEST, Bench, do
from tests.annotate.invariants import broken

SEEDS = st.integers(0, 2**32)


@given(seed=SEEDS, with_scheme=st.booleans())
@settings(max_examples=120)
def test_random_operations_break_no_rule_and_leave_no_trace_when_undone(seed: int, with_scheme: bool) -> None:
    chance = Random(seed)
    bench = Bench(
        Layer(),
        BLOCKS_SCHEME if with_scheme else None,
        layers={"machine": MACHINE},
        sessions={"other": OTHER},
    )
    bench.do(*BEGINNING)
    states, steps = [bench.layer], []
    for _ in range(15):
        asked = anything(chance, bench.layer)
        try:
            # the bench itself undoes and does every step again
            steps.append(bench.do(asked))
        except EcatError:
            continue
        states.append(bench.layer)
        assert list(broken(bench.layer)) == [], asked
    document = Document(states[0])
    for changes, state in zip(steps, states[1:], strict=True):
        document.apply(changes)
        assert document.layer() == state


@given(seed=SEEDS)
@settings(max_examples=25)
def test_random_steps_of_two_people_are_in_the_journal_as_they_were(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    chance = Random(seed)
    session = create_session(tmp_path_factory.mktemp("s") / "session", Draft(manifest=MANIFEST))
    editors = [Editor(open_session(session.path), "main", author) for author in ("ann", "bob")]
    states = [editors[0].layer]
    do(editors[0], *BEGINNING)
    states.append(editors[0].layer)
    for _ in range(12):
        who = chance.choice(editors)
        who.refresh()
        try:
            done = chance.randrange(6)
            if done == 0:
                who.undo()
            elif done == 1:
                who.redo()
            elif done == 2:
                who.restore(chance.randint(0, who.revision))
            else:
                do(who, anything(chance, who.layer))
        except EcatError:
            continue
        if who.revision == len(states):
            states.append(who.layer)
        assert list(broken(who.layer)) == []
    for editor in editors:
        editor.refresh()
        assert editor.layer == states[-1]
        for revision, state in enumerate(states):
            assert editor.at(revision) == state
    opened = open_session(session.path)
    assert opened.layer() == states[-1]
    assert validate(opened) == []


@given(seed=SEEDS)
@settings(max_examples=25)
def test_what_one_person_did_can_all_be_undone_and_all_be_done_again(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    chance = Random(seed)
    session = create_session(tmp_path_factory.mktemp("s") / "session", Draft(manifest=MANIFEST))
    editor = Editor(session, "main", "ann")
    first = editor.layer
    do(editor, *BEGINNING)
    for _ in range(10):
        try:
            do(editor, anything(chance, editor.layer))
        except EcatError:
            continue
    last, steps = editor.layer, editor.revision
    # undo outlives the process
    editor = Editor(open_session(session.path), "main", "ann")
    for _ in range(steps):
        editor.undo()
    assert editor.layer == first
    with pytest.raises(OperationError, match="cannot undo"):
        editor.undo()
    editor = Editor(open_session(session.path), "main", "ann")
    for _ in range(steps):
        editor.redo()
    assert editor.layer == last
    with pytest.raises(OperationError, match="cannot redo"):
        editor.redo()
