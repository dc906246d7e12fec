"""What is said of events, as texts and back."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.formats.interchange.facts import joined, labels_of, numbered, plain_name, split, told, understood
from ecat.model import AnnotatedObject, Event, Link, Role
from ecat.store import Session
from tests.formats.interchange.layers import TEXTS, base_session, layers, said_of

EVERYTHING = frozenset(
    {"text", "parent", "status", "unsure", "author", "role", "link", "reference", "predicate", "property"}
)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return base_session(Path(tmp_path_factory.mktemp("facts")), "uniform")


@given(st.lists(TEXTS.filter(lambda text: bool(text.strip())), max_size=5))
def test_texts_that_were_joined_are_parted_again(parts: list[str]) -> None:
    assert split(joined(parts)) == parts


def test_a_list_may_be_typed_by_hand() -> None:
    assert split("Shell;Stella Artois") == split("Shell; Stella Artois") == ["Shell", "Stella Artois"]


@given(st.data())
def test_what_is_told_is_understood(session: Session, data: st.DataObject) -> None:
    layer = data.draw(layers(session))
    labels = labels_of(layer.objects)
    ids = {label: name for name, label in labels.items()}
    for event in layer.events:
        again = understood(told(event, labels), ids.__getitem__)
        assert said_of(again, EVERYTHING) == said_of(event, EVERYTHING)


@given(st.data())
def test_every_object_has_a_label_of_its_own(session: Session, data: st.DataObject) -> None:
    things = data.draw(layers(session)).objects
    labels = labels_of(things)
    assert len(set(labels.values())) == len(things)
    assert not any(set(label) & set("/;|,()~") for label in labels.values())


def test_objects_go_by_their_names_where_these_tell_them_apart() -> None:
    names = ("Shell", "box", "box", "", "a/b", "o1")
    things = [AnnotatedObject(id=f"o{n}", name=name) for n, name in enumerate(names, 1)]
    assert list(labels_of(things).values()) == ["Shell", "o2", "o3", "o4", "o5", "o6"]


def test_roles_and_links_are_told_in_words() -> None:
    event = Event(
        id="a1",
        text="Slide Shell",
        unsure=True,
        roles=(
            Role(name="Agent", target="o1/HandRight", kind="joint"),
            Role(name="Theme", target="o2"),
            Role(name="Cause", target="a3", kind="event"),
        ),
        links=(Link(type="CAUSE", target="a2"),),
    )
    assert told(event, {"o1": "Performer 1", "o2": "Shell"}) == {
        "text": "Slide Shell",
        "unsure": "true",
        "role:Agent": "Performer 1/HandRight",
        "role:Theme": "Shell",
        "role:Cause": "event:a3",
        "links": "CAUSE a2",
    }


def test_unknown_names_are_properties() -> None:
    event = understood({"hand shape": "B", "status": "Proposed", "unsure": "x"}, str)
    assert [(p.name, p.value) for p in event.properties] == [("hand shape", "B")]
    assert (event.status, event.unsure) == ("proposed", True)


@given(st.lists(st.sampled_from(["a", "a #1", "a #2", "b"]), max_size=6))
def test_numbered_names_are_different_and_tell_the_name(names: list[str]) -> None:
    made: list[str] = []
    for name in names:
        made.append(numbered(name, made))
    assert len(set(made)) == len(made)
    assert [plain_name(name) for name in made] == names
