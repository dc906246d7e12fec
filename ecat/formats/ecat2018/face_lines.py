"""The markers of glyph boxes as lines of ``files.param``, from the tables ``markers_2d`` and ``markers_3d``."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ecat.errors import FormatError
from ecat.formats.ecat2018.elements import kept
from ecat.formats.ecat2018.lexical import (
    attribute,
    format_code,
    format_numbers,
    missing_corners,
    parse_code,
    text,
)
from ecat.formats.ecat2018.marker_reader import FACE_ATTRIBUTES
from ecat.formats.ecat2018.marks import KINECT_TO_CAMERA
from ecat.formats.ecat2018.number_text import parse_floats
from ecat.model import AnnotatedObject
from ecat.tables import MARKERS_2D, MARKERS_3D

ReadTable = Callable[[str], pa.Table | None]
"""Gives a table of the session by name, or None."""

_TABLES = {2: MARKERS_2D, 3: MARKERS_3D}
_FACTS = ("frame", "order", "present", "glyph_size", "code", "code_text", "corners_text")
_BATCH_ROWS = 16_384


class FaceLines:
    """Writes the marker lists of a session's glyph boxes."""

    def __init__(self, read: ReadTable) -> None:
        self._read = read
        self._tables: dict[int, pa.Table | None] = {}
        self._codes: dict[tuple[str | None, str | None], str] = {}

    def markers(self, thing: AnnotatedObject, dimensions: int) -> Iterator[str]:
        """The markers of an object, one at a time."""
        if dimensions not in self._tables:
            self._tables[dimensions] = self._read(_TABLES[dimensions].name)
        table = self._tables[dimensions]
        if table is None:
            return
        mine = table.filter(pc.equal(table["object_id"], pa.scalar(thing.id)))
        marker: list[str] = []
        for row in self._rows(mine, dimensions):
            if not row["order"]:  # the first face of a marker, or None: a marker without faces
                if marker:
                    yield "".join(marker) + "        </marker>\n"
                head = f"        <marker{_head(thing, row, dimensions)}"
                if row["order"] is None:
                    marker = []
                    yield f"{head} />\n"
                    continue
                marker = [f"{head}>\n"]
            marker.append(
                f"          <face>\n            <bounding>{text(row['corners'])}</bounding>\n"
                f"            <code>{self._code(row['code'], row['code_text'])}</code>\n          </face>\n"
            )
        if marker:
            yield "".join(marker) + "        </marker>\n"

    def _rows(self, table: pa.Table, dimensions: int) -> Iterator[dict[str, Any]]:
        """The rows as dictionaries, each with its ``corners`` as text."""
        names = [name for name in _TABLES[dimensions].arrow.names if name.endswith("_px") or name[0] in "xyz"]
        for batch in table.to_batches(max_chunksize=_BATCH_ROWS):
            numbers = np.column_stack([batch.column(name).to_numpy(zero_copy_only=False) for name in names])
            if dimensions == 3:
                numbers = numbers * np.tile(KINECT_TO_CAMERA, 4)
            facts = {name: batch.column(name).to_pylist() for name in _FACTS}
            texts = [format_numbers(row) for row in numbers.tolist()]
            for i, raw in enumerate(facts["corners_text"]):
                if raw is not None and _means(raw, numbers[i], dimensions):
                    texts[i] = raw
            columns = [*facts.values(), texts]
            for values in zip(*columns, strict=True):
                yield dict(zip((*_FACTS, "corners"), values, strict=True))

    def _code(self, code: str | None, raw: str | None) -> str:
        key = (code, raw)
        if key not in self._codes:
            same = raw is not None and (code is None or parse_code(raw) == code)
            self._codes[key] = text(raw) if same and raw is not None else format_code(code or "")
        return self._codes[key]


def _head(thing: AnnotatedObject, row: dict[str, Any], dimensions: int) -> str:
    values = {
        "type": "LOCATION" if row["present"] else "DELETE",
        "frame": str(row["frame"]),
        "glyphSize": str(row["glyph_size"] or 5),
    }
    note = kept(thing.foreign, f"marker{dimensions}d@{row['frame']}") if thing.foreign else None
    if note is None:
        return "".join([attribute(name, values[name]) for name in FACE_ATTRIBUTES[dimensions]])
    said: dict[str, str] = json.loads(note)
    # the texts count for what the table has no column for, or has not changed
    same_size = (row["glyph_size"] or 0) == 0
    now = said | {"frame": values["frame"]} | ({} if same_size else {"glyphSize": values["glyphSize"]})
    if "type" in said and (said["type"] == "DELETE") == row["present"]:
        now["type"] = values["type"]
    return "".join(attribute(name, now[name]) for name in said)


def _means(raw: str, numbers: NDArray[np.float64], dimensions: int) -> bool:
    """Whether the kept text still says what the table says (``numbers`` in the file's axes)."""
    try:
        values = parse_floats(raw, len(numbers))
    except FormatError:
        return bool(np.isnan(numbers).all())  # what could not be read stands for missing numbers
    if dimensions == 3:
        missing, _ = missing_corners(values.reshape(1, 4, 3))
        values = np.where(missing[..., None], np.nan, values.reshape(1, 4, 3)).ravel()
    else:
        values = np.where(np.isfinite(values), values, np.nan)
    return np.array_equal(values, numbers, equal_nan=True)
