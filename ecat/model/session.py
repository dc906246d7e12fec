"""A session's manifest: what is recorded, by which cameras, on which clock, and where every part is.

``session.json`` is this dataclass as JSON; ``schemas/session.schema.json`` is generated from it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A pinhole camera with Brown-Conrady distortion, and where it stands.

    ``mirrored`` images run against camera x: u = cx - fx * x / z.  ``rotation`` (quaternion x, y, z, w) and
    ``translation_m`` take points of ``camera/<name>`` into ``camera/<reference>`` (itself if empty).
    """

    name: str
    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    mirrored: bool = False
    distortion: tuple[float, ...] = ()
    reference: str = ""
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    source: str = ""


DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)
"""How many coefficients OpenCV's lens models have."""
_MOST_PX, _MOST_M, _MOST_COEFFICIENT = 1e6, 1e3, 1e6


def camera_problems(camera: Camera) -> Iterator[str]:
    """Fields whose values no camera has, each with what is expected; nothing that could be right is named."""
    for name in ("fx_px", "fy_px"):
        # "not in between", so that NaN is a problem too
        if not 0 < getattr(camera, name) <= _MOST_PX:
            yield f"{name}: expected a positive focal length in pixels, found {getattr(camera, name):g}"
    for name in ("cx_px", "cy_px"):
        if not abs(getattr(camera, name)) <= _MOST_PX:
            yield f"{name}: expected a place in pixels, found {getattr(camera, name):g}"
    if len(camera.distortion) not in DISTORTION_LENGTHS:
        lengths = ", ".join(map(str, DISTORTION_LENGTHS))
        yield f"distortion: expected {lengths} coefficients, found {len(camera.distortion)}"
    if not all(abs(value) <= _MOST_COEFFICIENT for value in camera.distortion):
        yield "distortion: expected finite coefficients of a lens"
    if not math.isclose(math.hypot(*camera.rotation), 1.0, abs_tol=1e-3):
        yield "rotation: expected a unit quaternion x, y, z, w"
    if not all(abs(value) <= _MOST_M for value in camera.translation_m):
        yield "translation_m: expected a place in metres"


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """How frames become times.

    ``rule``: ``recorded`` (a ``frames`` table holds each frame's time), ``uniform`` (``duration_ns`` spread evenly over
    ``n_frames`` images, first image at 0, last at ``duration_ns``) or ``unknown`` (no times).
    ``start`` is the wall clock at t = 0, ISO 8601, with an offset only if the recorder knew its time zone.
    """

    rule: Literal["recorded", "uniform", "unknown"] = "unknown"
    start: str | None = None
    duration_ns: int | None = None

    def t_ns(self, frame: int, n_frames: int) -> int | None:
        """Nanoseconds since the session's start at ``frame`` under the ``uniform`` rule, never before 0; else ``None``.

        Frames so far beyond the end that 64 bits cannot hold their time have none.
        """
        return self.times_ns((frame,), n_frames)[0]

    def times_ns(self, frames: Sequence[int], n_frames: int) -> list[int | None]:
        """:meth:`t_ns` of many frames."""
        if self.rule != "uniform" or self.duration_ns is None or n_frames < 2:
            return [None] * len(frames)
        twice, half, whole = 2 * self.duration_ns, n_frames - 1, 2 * (n_frames - 1)
        times = [(twice * frame + half) // whole for frame in frames]
        return [(t if t < 1 << 63 else None) if t > 0 else 0 for t in times]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """One recorded file.  ``present`` is false when the session names a file that was not there at import.

    ``depth_unit_m`` is what one unit of a depth image means, metres; depth is kept as it was recorded.
    """

    name: str
    kind: Literal["color", "depth", "infrared", "skeleton", "audio", "imu", "other"] = "other"
    file: str = ""
    present: bool = False
    codec: str = ""
    camera: str = ""
    n_frames: int | None = None
    width_px: int | None = None
    height_px: int | None = None
    depth_unit_m: float | None = None
    size_bytes: int | None = None
    sha256: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRecord:
    """One Parquet file of the session, and where its rows come from.

    ``stage`` is empty for what was imported.  ``inputs`` maps each input (a table's or a layer's name) to its sha256.
    """

    name: str
    file: str
    sha256: str
    rows: int
    schema_version: int = 1
    stage: str = ""
    stage_version: str = ""
    parameters: dict[str, object] = field(default_factory=dict[str, object])
    inputs: dict[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerRecord:
    """One annotation layer: its XML file, that file's hash, and how often it was committed.

    ``journal_revision`` and ``journal_bytes`` tell how much of the layer's journal the XML contains.
    """

    name: str
    file: str
    sha256: str
    revision: int = 1
    journal_revision: int = 0
    journal_bytes: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Where the session comes from: the format, the source's own name (never a full path), and what import noticed."""

    format: str = ""
    source: str = ""
    software: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """Everything there is to know about a session without opening a table."""

    schema_version: Literal[1] = 1
    name: str
    created: str
    revision: int = 1
    n_frames: int = 0
    clock: Clock = Clock()
    cameras: tuple[Camera, ...] = ()
    streams: tuple[Stream, ...] = ()
    layers: tuple[LayerRecord, ...] = ()
    tables: tuple[TableRecord, ...] = ()
    prototypes: tuple[dict[str, object], ...] = ()
    provenance: Provenance = Provenance()
    foreign: dict[str, str] = field(default_factory=dict[str, str])

    def camera(self, name: str) -> Camera | None:
        """The camera called ``name``."""
        return next((camera for camera in self.cameras if camera.name == name), None)

    def table(self, name: str) -> TableRecord | None:
        """The record of the table called ``name``."""
        return next((table for table in self.tables if table.name == name), None)

    def layer(self, name: str) -> LayerRecord | None:
        """The record of the layer called ``name``."""
        return next((layer for layer in self.layers if layer.name == name), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProjectManifest:
    """``project.json``: a folder of sessions (``project``) or of projects (``workspace``)."""

    schema_version: Literal[1] = 1
    kind: Literal["project", "workspace"] = "project"
    name: str
    created: str
    provenance: Provenance = Provenance()
    foreign: dict[str, str] = field(default_factory=dict[str, str])
