"""What a format can carry comes back equal, whatever the layer and whatever the clock."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ecat.formats.interchange import boris, coco, cvat, elan, epic, label_studio, plain_csv, via, vidat
from ecat.formats.interchange.leftovers import KINDS
from ecat.formats.interchange.source import shape_kind
from ecat.formats.interchange.times import FrameTimes, times_of
from ecat.model import Event, Layer, Segment
from ecat.model.annotation import ObjectKind
from ecat.store import Session
from tests.formats.interchange.layers import (
    Holding,
    Timing,
    base_session,
    drawn_of,
    events_of,
    key_shapes,
    layers,
    shapes_of,
    stretches_of,
    there_and_back,
)

MODULES: tuple[Any, ...] = (elan, cvat, label_studio, coco, via, vidat, epic, boris, plain_csv)
SHAPES: tuple[ObjectKind, ...] = ("rectangle", "polygon", "point")
TIMINGS = get_args(Timing)
SOME = settings(max_examples=20)


@pytest.fixture(scope="module", params=TIMINGS)
def base(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Session:
    """A session of each kind of clock, with an empty layer."""
    return base_session(Path(tmp_path_factory.mktemp("base")), request.param)


@pytest.fixture(scope="module")
def uniform(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """A session with an empty layer."""
    return base_session(Path(tmp_path_factory.mktemp("uniform")), "uniform")


def back(module: Any, base: Session, layer: Layer, **options: Any) -> Layer:
    with tempfile.TemporaryDirectory() as folder:
        return there_and_back(module.FORMAT, Holding(base, layer), Path(folder), **options)[0]


def merged(layer: Layer, times: FrameTimes) -> Layer:
    """The layer where stretches of an event that touch are one, as tags on images tell them."""

    def touch(event: Event) -> Event:
        found: list[Segment] = []
        for s in sorted(event.segments, key=lambda s: s.start_frame):
            if found and found[-1].end_frame == s.start_frame:
                s = times.of_frames(found.pop().start_frame, s.end_frame)  # noqa: PLW2901
            found.append(s)
        return replace(event, segments=tuple(found))

    return replace(layer, events=tuple(map(touch, layer.events)))


@pytest.mark.parametrize("module", [elan, via])
@SOME
@given(data=st.data())
def test_everything_said_of_events_comes_back(module: Any, base: Session, data: st.DataObject) -> None:
    layer = data.draw(layers(base))
    assert events_of(back(module, base, layer), module.CARRIES) == events_of(layer, module.CARRIES)


@SOME
@given(data=st.data())
def test_csv_brings_back_events_but_properties_without_a_value(base: Session, data: st.DataObject) -> None:
    def with_values(layer: Layer) -> Layer:
        """Their order is that of the columns, which all events share."""
        return replace(
            layer,
            events=tuple(
                replace(e, properties=tuple(sorted((p for p in e.properties if p.value), key=repr)))
                for e in layer.events
            ),
        )

    layer = with_values(data.draw(layers(base)))
    again = with_values(back(plain_csv, base, layer))
    assert events_of(again, plain_csv.CARRIES) == events_of(layer, plain_csv.CARRIES)


@SOME
@given(data=st.data())
def test_cvat_brings_back_events_as_tags(base: Session, data: st.DataObject) -> None:
    layer = merged(data.draw(layers(base)), times_of(base))
    assert events_of(back(cvat, base, layer), cvat.CARRIES) == events_of(layer, cvat.CARRIES)


@SOME
@given(data=st.data())
def test_label_studio_brings_back_events_and_their_links(base: Session, data: st.DataObject) -> None:
    layer = data.draw(layers(base))
    # of what leads from what is proposed to what is not, there is no relation
    status = data.draw(st.sampled_from(["confirmed", "proposed"]))
    layer = replace(layer, events=tuple(replace(event, status=status) for event in layer.events))
    carries = label_studio.CARRIES - {"link"}
    again = back(label_studio, base, layer)
    assert events_of(again, carries) == events_of(layer, carries)
    for event, same in zip(*(sorted(x.events, key=lambda e: e.id) for x in (layer, again)), strict=True):
        assert sorted(map(repr, same.links)) == sorted(map(repr, event.links))


@pytest.mark.parametrize("module", [boris, epic, vidat])
@SOME
@given(data=st.data())
def test_stretches_come_back_where_events_are_not_known(
    module: Any, base: Session, data: st.DataObject
) -> None:
    layer = data.draw(layers(base, apart=module is boris))
    carries = module.CARRIES - {"role"}
    assert stretches_of(back(module, base, layer), carries) == stretches_of(layer, carries)


@SOME
@given(data=st.data())
def test_epic_brings_back_what_takes_part_as_nouns(uniform: Session, data: st.DataObject) -> None:
    layer = data.draw(layers(uniform))
    layer = replace(layer, events=tuple(replace(e, segments=e.segments[:1]) for e in layer.events))
    again = {event.id: event for event in back(epic, uniform, layer).events}
    for event in layer.events:
        mine = [r.target.partition("/")[0] for r in event.roles if r.kind != "event" and r.name != "Agent"]
        assert [role.target for role in again[event.id].roles] == list(dict.fromkeys(mine))


@pytest.mark.parametrize("module", [cvat, coco, vidat, label_studio])
@SOME
@given(data=st.data())
def test_shapes_come_back_in_every_image(module: Any, uniform: Session, data: st.DataObject) -> None:
    kinds: tuple[ObjectKind, ...] = tuple(kind for kind in SHAPES if kind in module.CARRIES)
    layer = data.draw(layers(uniform, kinds))
    again = back(module, uniform, layer)
    assert shapes_of(again, module.CARRIES) == drawn_of(layer, module.CARRIES)
    mine = {thing.id: thing for thing in layer.objects}
    for thing in (thing for thing in again.objects if thing.key_frames):
        assert shape_kind(thing) == shape_kind(mine[thing.id])
        if "object type" in module.CARRIES:
            assert thing.semantic_type == mine[thing.id].semantic_type
        if "object property" in module.CARRIES:
            assert sorted(map(repr, thing.properties)) == sorted(map(repr, mine[thing.id].properties))


@SOME
@given(data=st.data())
def test_via_brings_back_what_was_drawn(uniform: Session, data: st.DataObject) -> None:
    layer = data.draw(layers(uniform))
    again = back(via, uniform, layer).objects
    there = {t.id: {key.frame: key.coordinates for key in t.key_frames} for t in again if t.key_frames}
    assert there == key_shapes(layer)


@pytest.mark.parametrize("module", MODULES)
@settings(max_examples=5)
@given(data=st.data())
def test_the_same_layer_gives_the_same_bytes(module: Any, uniform: Session, data: st.DataObject) -> None:
    layer = data.draw(layers(uniform))
    with tempfile.TemporaryDirectory() as folder:
        made: list[bytes] = []
        for name in ("one", "other"):
            dest = Path(folder) / name
            module.part(Holding(uniform, layer), "s", dest, module.FORMAT.options(), lambda *_: None)
            made.append(dest.read_bytes())
    assert made[0] == made[1]


@pytest.mark.parametrize("module", MODULES)
def test_a_format_carries_kinds_that_there_are(module: Any) -> None:
    assert KINDS.keys() >= module.CARRIES
    assert getattr(module, "PARTLY", frozenset()) <= KINDS.keys() - module.CARRIES


@pytest.mark.parametrize("module", MODULES)
def test_an_empty_layer_is_written_and_read(module: Any, uniform: Session, tmp_path: Path) -> None:
    layer, findings = there_and_back(module.FORMAT, uniform, tmp_path)
    assert (layer.events, layer.objects) == ((), ())
    assert not [line for line in findings if "no place" in line]


@pytest.mark.parametrize("module", [elan, cvat, label_studio, via, vidat, epic, boris, plain_csv])
def test_stretches_that_no_program_can_have_are_made_possible_and_named(
    module: Any, uniform: Session, tmp_path: Path
) -> None:
    spans = {"none": (10, 10), "reverse": (20, 15), "before": (-8, -3), "partly": (-8, 3), "fine": (40, 50)}
    events = tuple(
        Event(id=f"a{n}", type=name, text=name, segments=(Segment(start_frame=start, end_frame=end),))
        for n, (name, (start, end)) in enumerate(spans.items())
    )
    layer, findings = there_and_back(module.FORMAT, Holding(uniform, Layer(events=events)), tmp_path)
    found = {event.type: [(s.start_frame, s.end_frame) for s in event.segments] for event in layer.events}
    assert found == {
        "none": [(10, 11)],
        "reverse": [(20, 21)],
        "before": [(0, 1)],
        "partly": [(0, 3)],
        "fine": [(40, 50)],
    }
    assert [line for line in findings if line.endswith("were made possible: of a0, a1, a2, a3")]


def test_a_stretch_within_one_image_keeps_its_times(uniform: Session, tmp_path: Path) -> None:
    within = Segment(start_frame=10, end_frame=10, start_ns=405_000_000, end_ns=409_000_000)
    event = Event(id="a0", type="tap", text="tap", segments=(within,))
    layer, _ = there_and_back(elan.FORMAT, Holding(uniform, Layer(events=(event,))), tmp_path)
    assert [(s.start_ns, s.end_ns) for s in layer.events[0].segments] == [(405_000_000, 409_000_000)]
