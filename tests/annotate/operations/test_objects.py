"""Objects, their shapes and when they are there."""

from __future__ import annotations

from typing import Any

import pytest

from ecat.annotate.operations.objects import distinct_color
from ecat.model import AnnotatedObject, Argument, KeyFrame, Layer, Relation
from ecat.model.holding import presence
from ecat.model.shapes import shape_at
from tests.annotate.bench import STEP_NS, Bench, event, op, relation, thing

SQUARE = [10, 20, 30, 40]


def the(bench: Bench, name: str = "o1") -> AnnotatedObject:
    found = bench.document.object(name)
    assert found is not None
    return found


def frames(bench: Bench) -> list[tuple[int, bool]]:
    """The key frames of the object: where, and whether it is there."""
    return [(key.frame, key.present) for key in the(bench).key_frames]


@pytest.fixture
def cup(bench: Bench) -> Bench:
    """A rectangle, drawn at frames 10 and 20."""
    bench.do(thing("cup", "rectangle", frame=10, coordinates=SQUARE))
    bench.do(op("set_key_frame", object="o1", frame=20, coordinates=[20, 20, 30, 60]))
    return bench


class TestObjects:
    def test_a_new_object_has_its_shape_and_the_video(self, bench: Bench) -> None:
        bench.do(thing("cup", "rectangle", frame=10, coordinates=SQUARE))
        made = the(bench)
        assert made.key_frames == (KeyFrame(frame=10, t_ns=10 * STEP_NS, coordinates=(10, 20, 30, 40)),)
        assert (made.stream, made.origin, made.interpolation) == ("color", "manual", "linear")

    def test_colors_repeat_late(self) -> None:
        assert len({distinct_color(n) for n in range(500)}) > 450

    def test_what_is_given_can_be_edited(self, cup: Bench) -> None:
        cup.do(op("edit_object", id="o1", name="mug", color="#00FF00", line_width=3, interpolation="hold"))
        made = the(cup)
        assert (made.name, made.color, made.line_width, made.interpolation) == ("mug", "#00ff00ff", 3, "hold")
        assert len(made.key_frames) == 2

    @pytest.mark.parametrize(
        ("said", "problem"), [({"color": "red"}, "is no color"), ({"line_width": 11}, "11 pixels wide")]
    )
    def test_nonsense_is_refused(self, cup: Bench, said: dict[str, Any], problem: str) -> None:
        assert problem in cup.refused(op("edit_object", id="o1", **said))

    def test_what_names_a_removed_object_goes_with_it(self, bench: Bench) -> None:
        bench.do(
            thing("cup"),
            thing("body", "rig"),
            event(0, 9, text="cup", roles={"Theme": "o1", "Agent": "o2/HandLeft"}),
        )
        bench.do(op("find_references"), relation("ON", "o1", "o2"), relation("STAND", "o2"))
        bench.do(op("remove_object", id="o1"))
        assert [r.name for r in bench.event().roles] == ["Agent"]
        assert bench.event().references == ()
        assert [r.predicate for r in bench.layer.relations] == ["STAND"]
        bench.do(op("remove_object", id="o2"))
        assert (bench.event().roles, bench.layer.relations) == ((), ())

    @pytest.mark.parametrize(
        ("kind", "coordinates", "problem"),
        [
            ("rectangle", [1, 2, 3], "expected u, v, width, height"),
            ("rectangle", [1, 2, 0, 4], "not positive"),
            ("polygon", [1, 2, 3], "u, v of every vertex"),
            ("polygon", [], "u, v of every vertex"),
            ("point", [1, 2, 3, 4], "expected u, v"),
            ("point", [1e300, 2], "no place"),
            ("rig", [1, 2], "in tables"),
        ],
    )
    def test_shapes_fit_their_kind(
        self, bench: Bench, kind: str, coordinates: list[float], problem: str
    ) -> None:
        assert problem in bench.refused(thing("", kind, frame=0, coordinates=coordinates))

    def test_objects_may_be_drawn_in_space(self, bench: Bench) -> None:
        bench.do(thing("top", "polygon", dimensions=3, frame=0, coordinates=[0, 0, 1, 1, 0, 1, 1, 1, 1]))
        assert len(the(bench).key_frames_3d) == 1
        bench.do(op("set_key_frame", object="o1", frame=5, coordinates=[0, 0, 2], dimensions=3))
        assert [key.frame for key in the(bench).key_frames_3d] == [0, 5]
        bench.do(op("remove_key_frame", object="o1", frame=0, dimensions=3))
        assert [key.frame for key in the(bench).key_frames_3d] == [5]


class TestShapesInBetween:
    @pytest.mark.parametrize(
        ("frame", "shape"),
        [
            (9, None),
            (10, (10, 20, 30, 40)),
            (15, (15, 20, 30, 50)),
            (20, (20, 20, 30, 60)),
            (99, (20, 20, 30, 60)),
        ],
    )
    def test_a_shape_moves_in_a_straight_line(
        self, cup: Bench, frame: int, shape: tuple[float, ...] | None
    ) -> None:
        assert shape_at(the(cup), frame) == shape

    def test_or_stays(self, cup: Bench) -> None:
        cup.do(op("edit_object", id="o1", interpolation="hold"))
        assert shape_at(the(cup), 19) == (10, 20, 30, 40)

    def test_polygons_move_too_where_they_have_as_many_corners(self, bench: Bench) -> None:
        bench.do(thing("", "polygon", frame=0, coordinates=[0, 0, 10, 0, 0, 10]))
        bench.do(op("set_key_frame", object="o1", frame=10, coordinates=[10, 0, 20, 0, 10, 10]))
        bench.do(op("set_key_frame", object="o1", frame=20, coordinates=[0, 0, 1, 1]))
        assert shape_at(the(bench), 5) == (5, 0, 15, 0, 5, 10)
        assert shape_at(the(bench), 15) == (10, 0, 20, 0, 10, 10)

    def test_a_shape_does_not_move_towards_an_absence(self, cup: Bench) -> None:
        cup.do(op("set_absent", object="o1", frame=30))
        assert shape_at(the(cup), 29) == (20, 20, 30, 60)
        assert shape_at(the(cup), 30) is None


class TestKeyFrames:
    def test_what_is_shown_is_kept_where_nothing_else_is_drawn(self, cup: Bench) -> None:
        cup.do(op("set_key_frame", object="o1", frame=15))
        assert the(cup).key_frames[1].coordinates == (15, 20, 30, 50)

    def test_where_nothing_is_shown_it_is_the_next_shape_or_the_last(self, cup: Bench) -> None:
        cup.do(op("set_absent", object="o1", frame=25))
        cup.do(op("set_key_frame", object="o1", frame=5))
        cup.do(op("set_key_frame", object="o1", frame=40))
        assert the(cup).key_frames[0].coordinates == (10, 20, 30, 40)
        assert the(cup).key_frames[-1].coordinates == (20, 20, 30, 60)

    def test_of_an_object_that_was_never_drawn_there_is_none(self, bench: Bench) -> None:
        bench.do(thing("cup", "rectangle"))
        assert "no shape yet" in bench.refused(op("set_key_frame", object="o1", frame=0))

    def test_an_absence_takes_the_next_one_in(self, cup: Bench) -> None:
        cup.do(op("set_absent", object="o1", frame=30), op("set_absent", object="o1", frame=25))
        assert frames(cup) == [(10, True), (20, True), (25, False)]

    def test_a_key_frame_is_removed(self, cup: Bench) -> None:
        cup.do(op("remove_key_frame", object="o1", frame=10))
        assert frames(cup) == [(20, True)]
        assert "no key frame" in cup.refused(op("remove_key_frame", object="o1", frame=10))

    @pytest.mark.parametrize("frame", [-1, 1000])
    def test_it_is_in_the_recording(self, cup: Bench, frame: int) -> None:
        assert "not in the recording" in cup.refused(op("set_key_frame", object="o1", frame=frame))


class TestPresence:
    def there(self, bench: Bench) -> list[tuple[int, int | None]]:
        return list(presence(the(bench)))

    def test_an_absence_at_the_first_frame_counts(self, cup: Bench) -> None:
        cup.do(op("set_absent", object="o1", frame=0))
        assert self.there(cup) == [(10, None)]

    def test_an_object_is_there_for_a_stretch(self, cup: Bench) -> None:
        cup.do(op("set_absent", object="o1", frame=30))
        cup.do(op("set_presence", object="o1", start_frame=50, end_frame=60))
        assert self.there(cup) == [(10, 30), (50, 60)]
        cup.do(op("set_presence", object="o1", start_frame=20, end_frame=55))
        assert self.there(cup) == [(10, 60)]

    def test_it_is_away_for_a_stretch_and_looks_as_before_after_it(self, cup: Bench) -> None:
        cup.do(op("set_presence", object="o1", start_frame=12, end_frame=15, present=False))
        assert self.there(cup) == [(10, 12), (15, None)]
        assert shape_at(the(cup), 15) == (15, 20, 30, 50)

    def test_to_the_end_means_to_the_end(self, cup: Bench) -> None:
        cup.do(op("set_presence", object="o1", start_frame=15, present=False))
        assert self.there(cup) == [(10, 15)]
        cup.do(op("set_presence", object="o1", start_frame=30, end_frame=1000))
        assert self.there(cup) == [(10, 15), (30, None)]

    def test_boxes_with_marks_are_where_their_marks_are(self, bench: Bench) -> None:
        bench.do(thing("Shell", "marker_box"))
        assert "its tables say" in bench.refused(op("set_absent", object="o1", frame=3))


class TestCopies:
    DRAWN = KeyFrame(frame=3, coordinates=(1, 2, 3, 4))
    MOVED = KeyFrame(frame=9, coordinates=(5, 6, 7, 8))
    GONE = KeyFrame(frame=9, present=False)
    OTHER = Layer(
        objects=(
            AnnotatedObject(
                id="o1", name="cup", kind="rectangle", color="#00ff00ff", semantic_type="mug",
                key_frames=(DRAWN, MOVED),
            ),
            AnnotatedObject(id="o2", name="gone", kind="rectangle", key_frames=(DRAWN, GONE)),
            AnnotatedObject(id="o3", name="body", kind="rig"),
        ),
        relations=(
            Relation(id="r1", predicate="STAND", start_frame=0, arguments=(Argument(target="o1"),)),
            Relation(id="r2", predicate="SIT", start_frame=5, arguments=(Argument(target="o1"),)),
            Relation(id="r3", predicate="ON", start_frame=5, arguments=(Argument(target="o3"), Argument(target="o1"))),
            Relation(id="r4", predicate="NEAR", start_frame=0, end_frame=8, arguments=(Argument(target="o1"),)),
        ),
    )  # fmt: skip

    @pytest.fixture
    def beside(self) -> Bench:
        return Bench(Layer(), sessions={"other": self.OTHER})

    def test_a_copy_is_the_same_thing_as_its_original(self, beside: Bench) -> None:
        beside.do(op("copy_objects", session="other", frame=7))
        (copy,) = beside.layer.objects
        assert (copy.id, copy.name, copy.color, copy.semantic_type) == ("o1", "cup", "#00ff00ff", "")
        assert [(key.frame, key.coordinates) for key in copy.key_frames] == [(7, (5, 6, 7, 8))]
        facts = {r.predicate: (r.targets, r.start_frame) for r in beside.layer.relations}
        assert facts == {"IDENTITY": (("o1", "other/o1"), 7), "SIT": (("o1",), 7)}

    def test_what_is_gone_is_copied_from_its_last_appearance(self, beside: Bench) -> None:
        beside.do(op("copy_objects", session="other", frame=7, objects=["o2"], mode="last_appearance"))
        assert [(t.name, t.key_frames[0].coordinates) for t in beside.layer.objects] == [
            ("gone", (1, 2, 3, 4))
        ]

    def test_what_is_not_there_is_an_error(self, beside: Bench) -> None:
        assert "has no object o9" in beside.refused(
            op("copy_objects", session="other", frame=7, objects=["o9"])
        )
        assert "no session" in beside.refused(op("copy_objects", session="else", frame=7))
