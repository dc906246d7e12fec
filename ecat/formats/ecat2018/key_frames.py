"""Drawn markers of ``files.param`` (``<marker>`` with a list of numbers): to key frames and back to the same text."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ecat.errors import FormatError
from ecat.formats.ecat2018.elements import (
    attribute_facts,
    attributes_of,
    fact,
    frame_number,
    kept,
    kept_attributes,
    refused,
)
from ecat.formats.ecat2018.lexical import format_numbers, missing_corners
from ecat.formats.ecat2018.marks import KINECT_TO_CAMERA
from ecat.formats.ecat2018.number_text import parse_floats
from ecat.formats.ecat2018.xml_input import Element
from ecat.model import Foreign, KeyFrame

_ATTRIBUTES = {2: ("type", "frame"), 3: ("frame",)}


def coordinates_of(text: str, dimensions: int) -> tuple[float, ...]:
    """The numbers of a drawn marker: pixels, or metres in ``camera/depth`` with NaN for missing points.

    Raises
    ------
    FormatError : not a list of numbers.
    """
    values = parse_floats(text.strip())
    if dimensions == 3 and len(values) % 3 == 0:
        points = values.reshape(1, -1, 3)
        missing, _ = missing_corners(points)
        values = np.where(missing[..., None], np.nan, points * KINECT_TO_CAMERA).ravel()
    else:
        values = np.where(np.isfinite(values), values, np.nan)
    return tuple((values + 0.0).tolist())  # + 0.0 makes 0 of -0


def coordinates_text(coordinates: Sequence[float], dimensions: int) -> str:
    """How ECAT writes ``coordinates`` (:func:`coordinates_of`)."""
    if dimensions == 3 and len(coordinates) % 3 == 0:
        return format_numbers(value if i % 3 == 2 else -value for i, value in enumerate(coordinates))
    return format_numbers(coordinates)


def key_frame_of(element: Element, dimensions: int, what: str, bad: Callable[[str], None]) -> KeyFrame:
    """A drawn marker; ``bad`` is called with the place of one whose numbers cannot be read, and may raise.

    Raises
    ------
    FormatError : no frame, an unknown type, or elements inside.
    """
    line = element.sourceline or 0
    said = attributes_of(element, what)
    number = frame_number(said.get("frame"), what, line)
    text = element.text or ""
    kind = said.get("type")
    if kind not in {None, "LOCATION", "DELETE"} or len(element):
        where = f"line {line}: a drawn marker of type {kind!r} with {len(element)} child elements"
        raise refused(what, where, "correct or remove the marker")
    coordinates: tuple[float, ...] = ()
    try:
        coordinates = coordinates_of(text, dimensions)
    except FormatError as error:
        bad(f"line {line}, <marker> of frame {number}: {error.where}")
    foreign: list[Foreign] = []
    if coordinates_text(coordinates, dimensions) != text:
        foreign.append(fact("text", text))
    usual = _ATTRIBUTES[dimensions]
    foreign += attribute_facts(said, usual, usual)
    return KeyFrame(
        frame=number - 1, present=kind != "DELETE", coordinates=coordinates, foreign=tuple(foreign)
    )


def key_frame_attributes(key: KeyFrame, dimensions: int) -> list[tuple[str, str]]:
    """The attributes of a drawn marker."""
    values = {"type": "LOCATION" if key.present else "DELETE", "frame": str(key.frame + 1)}
    return kept_attributes({name: values[name] for name in _ATTRIBUTES[dimensions]}, key.foreign)


def key_frame_text(key: KeyFrame, dimensions: int) -> str:
    """The text of a drawn marker: as the file said while it still means the same, else in the usual form."""
    raw = kept(key.foreign, "text")
    if raw is not None and _means(raw, key.coordinates, dimensions):
        return raw
    return coordinates_text(key.coordinates, dimensions)


def _means(text: str, coordinates: Sequence[float], dimensions: int) -> bool:
    try:
        values = coordinates_of(text, dimensions)
    except FormatError:
        values = ()
    return np.array_equal(np.array(values), np.array(coordinates), equal_nan=True)
