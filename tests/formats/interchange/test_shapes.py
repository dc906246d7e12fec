"""Shapes image by image, and the key frames that say the same."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from ecat.formats.interchange.shapes import (
    absences,
    area_of,
    box_around,
    first_images,
    shape_in,
    shapes,
    simplified,
    straight,
)
from ecat.model import AnnotatedObject, KeyFrame
from ecat.model.shapes import shape_at
from tests.formats.interchange.layers import N_FRAMES, objects

ANY = objects(("rectangle", "polygon", "point"))


def image_by_image(thing: AnnotatedObject) -> dict[int, tuple[float, ...]]:
    at = {frame: shape_at(thing, frame) for frame in range(N_FRAMES)}
    return {frame: shape for frame, shape in at.items() if shape is not None}


def rounded(found: dict[int, tuple[float, ...]]) -> dict[int, tuple[float, ...]]:
    return {frame: tuple(round(x, 4) for x in shape) for frame, shape in found.items()}


@given(ANY)
def test_shapes_are_those_that_the_model_tells(things: tuple[AnnotatedObject, ...]) -> None:
    for thing in things:
        assert rounded(dict(shapes(thing, N_FRAMES))) == rounded(image_by_image(thing))
        keys = first_images(thing.key_frames)
        one_by_one = {frame: shape_in(thing, keys, frame) for frame in range(N_FRAMES)}
        assert {f: s for f, s in one_by_one.items() if s is not None} == image_by_image(thing)


@given(ANY)
def test_straight_key_frames_need_no_holding(things: tuple[AnnotatedObject, ...]) -> None:
    for thing in things:
        moved = AnnotatedObject(id="o", kind=thing.kind, key_frames=tuple(straight(thing)))
        assert rounded(image_by_image(moved)) == rounded(image_by_image(thing))


@given(ANY)
def test_shapes_of_every_image_become_the_key_frames_that_they_were_made_of(
    things: tuple[AnnotatedObject, ...],
) -> None:
    for thing in things:
        dense = absences(dict(shapes(thing, N_FRAMES)), range(N_FRAMES))
        again = AnnotatedObject(id="o", kind=thing.kind, key_frames=simplified(list(dense)))
        assert rounded(image_by_image(again)) == rounded(image_by_image(thing))
        assert len(again.key_frames) <= len(straight(thing))


def test_a_straight_way_keeps_its_ends_only() -> None:
    keys = [KeyFrame(frame=frame, coordinates=(2.0 * frame, 1.0)) for frame in range(10)]
    keys += [KeyFrame(frame=frame, coordinates=(18.0, 1.0)) for frame in range(10, 20)]
    assert [key.frame for key in simplified(keys)] == [0, 9]


def test_the_position_before_the_first_image_shows_it() -> None:
    keys = (KeyFrame(frame=-1, coordinates=(1, 2)), KeyFrame(frame=4, coordinates=(3, 4)))
    assert [key.frame for key in first_images(keys)] == [0, 4]


@given(st.lists(st.floats(-1e3, 1e3), min_size=6, max_size=12).filter(lambda xs: len(xs) % 2 == 0))
def test_a_polygon_is_no_larger_than_the_box_around_it(points: list[float]) -> None:
    _, _, width, height = box_around(points)
    if len(points) == 6:
        assert area_of(points) <= width * height / 2 + 1e-3


def test_the_area_of_a_square() -> None:
    assert area_of([0, 0, 2, 0, 2, 2, 0, 2]) == 4
