"""Whatever is done, everything can be undone exactly, the journal tells the same, and no rule is broken."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ecat.annotate import OPERATIONS, Editor
from ecat.errors import EcatError, OperationError
from ecat.model import Event, Layer, Relation, Role, Segment
from ecat.model.annotation import Argument
from ecat.model.document import Document
from ecat.model.scheme import BLOCKS_SCHEME
from ecat.store import Draft, create_session, open_session, validate
from tests.annotate.bench import MANIFEST, N_FRAMES, Bench, do
from tests.annotate.invariants import broken

FRAMES = st.integers(-1, 60) | st.integers(0, N_FRAMES)
SPANS = st.tuples(FRAMES, st.integers(0, 40)).map(lambda pair: [pair[0], pair[0] + pair[1]])
TEXTS = st.sampled_from(["", "cup", "Cup beside the cup", "box", "put the box on the cup, cupboard"])
TYPES = st.sampled_from(["", "slide_next", "grasp", "move"])
ROLES = st.sampled_from(["Agent", "Theme"])
TIERS = st.sampled_from(["", "event", "sub-event"])
CAUSE = Role(name="Cause", target="a1", kind="event")
MACHINE = Layer(
    name="machine",
    events=(
        Event(id="a1", type="slide", segments=(Segment(start_frame=5, end_frame=30),), status="proposed"),
        Event(id="a2", parent="a1", segments=(Segment(start_frame=6, end_frame=9),), status="proposed"),
        Event(id="a3", segments=(Segment(start_frame=40, end_frame=50),), roles=(CAUSE,)),
    ),
    relations=(Relation(id="r1", predicate="ON", start_frame=3, arguments=(Argument(target="o1"),)),),
)  # fmt: skip


def some(*kinds: str, layer: Layer) -> st.SearchStrategy[str]:
    """Ids of a layer, mostly ones that it has."""
    ids: list[str] = []
    for kind in kinds:
        ids += [item.id for item in getattr(layer, f"{kind}s")]
    return (
        st.sampled_from([*ids, "o99"]) if not ids else st.sampled_from(ids) | st.sampled_from([*ids, "a99"])
    )


def operation(layer: Layer) -> st.SearchStrategy[dict[str, Any]]:
    """Anything that may be asked of a layer."""
    events, things, relations = (some(kind, layer=layer) for kind in ("event", "object", "relation"))
    maybe = lambda strategy: st.none() | strategy  # noqa: E731
    fields: dict[str, dict[str, st.SearchStrategy[Any]]] = {
        "add_object": {
            "kind": st.just("rectangle"), "name": st.sampled_from(["cup", "box", "the box"]), "frame": FRAMES,
            "coordinates": st.just([1.0, 2.0, 3.0, 4.0]),
        },
        "edit_object": {"id": things, "name": TEXTS},
        "remove_object": {"id": things},
        "set_property": {"target": things | events, "name": st.sampled_from("ab"), "value": maybe(TEXTS)},
        "set_key_frame": {"object": things, "frame": FRAMES, "coordinates": maybe(st.just([5, 6, 7, 8]))},
        "set_absent": {"object": things, "frame": FRAMES},
        "remove_key_frame": {"object": things, "frame": FRAMES},
        "set_presence": {"object": things, "start_frame": FRAMES, "end_frame": maybe(FRAMES), "present": st.booleans()},
        "copy_objects": {"session": st.just("other"), "frame": FRAMES},
        "add_event": {
            "segments": st.lists(SPANS, min_size=1, max_size=3), "type": TYPES, "tier": TIERS,
            "parent": maybe(events), "text": TEXTS, "roles": st.dictionaries(ROLES, things),
        },
        "edit_event": {"id": events, "text": TEXTS, "tier": TIERS, "type": TYPES, "unsure": st.booleans()},
        "remove_event": {"id": events, "children": st.sampled_from(["remove", "keep"])},
        "set_segments": {"id": events, "segments": st.lists(SPANS, max_size=3)},
        "move_edge": {
            "id": events, "edge": st.sampled_from(["start", "end"]), "frame": FRAMES, "segment": st.integers(0, 1),
            "children": st.sampled_from(["refuse", "clip"]),
        },
        "move_event": {"id": events, "frames": st.integers(-30, 30)},
        "add_segment": {"id": events, "start_frame": FRAMES, "end_frame": FRAMES},
        "remove_segment": {"id": events, "segment": st.integers(-1, 2)},
        "split_event": {"id": events, "frame": FRAMES},
        "merge_events": {"ids": st.lists(events, max_size=3)},
        "set_parent": {"id": events, "parent": maybe(events)},
        "link_events": {"id": events, "type": st.just("CAUSE"), "target": events},
        "unlink_events": {"id": events, "type": st.just("CAUSE"), "target": events},
        "set_role": {"id": events, "role": st.sampled_from(["Agent", "Theme"]), "target": maybe(things | events)},
        "add_reference": {"id": events, "start": st.integers(0, 9), "end": st.integers(0, 9), "target": things},
        "remove_reference": {"id": events, "start": st.integers(0, 9), "end": st.integers(0, 9)},
        "find_references": {},
        "set_predicates": {"id": events, "predicates": st.lists(st.just({"start": 0, "end": 3, "type": "put"}))},
        "set_slots": {"id": events, "subject": maybe(things), "verb": maybe(TYPES), "adjunct": maybe(TEXTS)},
        "add_relation": {
            "predicate": st.sampled_from(["ON", "STAND", "SIT", "LOOK_AT"]), "start_frame": FRAMES,
            "arguments": st.lists(things, min_size=1, max_size=2), "polarity": st.booleans(),
            "end_frame": maybe(FRAMES),
        },
        "edit_relation": {"id": relations, "start_frame": maybe(FRAMES), "polarity": maybe(st.booleans())},
        "remove_relation": {"id": relations},
        "accept_proposal": {
            "proposal": st.sampled_from(["machine/a1", "machine/a2", "machine/a3", "machine/r1"]),
            "start_frame": maybe(FRAMES), "end_frame": maybe(FRAMES),
        },
        "reject_proposal": {"proposal": st.sampled_from(["machine/a1", "machine/a2", "machine/a3", "machine/r1"])},
        "set_scheme": {"name": st.just("")},
        "add_windows": {
            "start": FRAMES, "step": st.integers(100, 400), "duration": st.integers(1, 200), "tier": TIERS,
            "existing": st.sampled_from(["add", "replace", "skip", "clear"]),
        },
    }  # fmt: skip
    assert fields.keys() == OPERATIONS.keys()
    ops = [st.fixed_dictionaries({"op": st.just(name), **said}) for name, said in fields.items()]
    # nothing happens to a layer without anything in it
    return st.one_of(*([often for often in (ops[0], ops[9]) for _ in range(4)] + ops))


@given(data=st.data(), with_scheme=st.booleans())
@settings(max_examples=120, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
def test_random_operations_break_no_rule_and_leave_no_trace_when_undone(
    data: st.DataObject, with_scheme: bool
) -> None:
    other = Layer(name="other", objects=Bench(Layer()).layer.objects)
    bench = Bench(
        Layer(),
        BLOCKS_SCHEME if with_scheme else None,
        layers={"machine": MACHINE},
        sessions={"other": other},
    )
    states, steps = [bench.layer], []
    for _ in range(data.draw(st.integers(1, 14))):
        asked = data.draw(operation(bench.layer))
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


@given(data=st.data())
@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
def test_random_steps_of_two_people_are_in_the_journal_as_they_were(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    session = create_session(tmp_path_factory.mktemp("s") / "session", Draft(manifest=MANIFEST))
    editors = [Editor(open_session(session.path), "main", author) for author in ("ann", "bob")]
    states = [editors[0].layer]
    for _ in range(data.draw(st.integers(1, 10))):
        who = data.draw(st.sampled_from(editors))
        who.refresh()
        try:
            done = data.draw(st.integers(0, 5))
            if done == 0:
                who.undo()
            elif done == 1:
                who.redo()
            elif done == 2:
                who.restore(data.draw(st.integers(0, who.revision)))
            else:
                do(who, data.draw(operation(who.layer)))
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


@given(data=st.data())
@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
def test_what_one_person_did_can_all_be_undone_and_all_be_done_again(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    session = create_session(tmp_path_factory.mktemp("s") / "session", Draft(manifest=MANIFEST))
    editor = Editor(session, "main", "ann")
    first = editor.layer
    for _ in range(data.draw(st.integers(1, 8))):
        try:
            do(editor, data.draw(operation(editor.layer)))
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
