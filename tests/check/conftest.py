"""A healthy patient, which each test gives exactly one disease."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from ecat.check.finding import Patient
from ecat.model import (
    AnnotatedObject,
    Camera,
    Clock,
    CodingScheme,
    Event,
    EventType,
    KeyFrame,
    Layer,
    Link,
    Manifest,
    PredicateType,
    Relation,
    Role,
    RoleType,
    Segment,
    Stream,
    TextReference,
    Tier,
)
from ecat.model.annotation import Argument
from ecat.tables import TABLES

N_FRAMES = 120
PERIOD_NS = 33_333_333
BOX_M = 0.15

SCHEME = CodingScheme(
    name="boxes",
    tiers=(Tier(name="event"), Tier(name="sub-event", parent="event", constraint="included_in")),
    event_types=(
        EventType(name="slide", roles=(RoleType(name="theme", required=True), RoleType(name="hand"))),
    ),
    predicates=(
        PredicateType(name="SUPPORT"),
        PredicateType(name="STAND", arity=1),
        PredicateType(name="CAUSE", target="event"),
    ),
)

LAYER = Layer(
    scheme="boxes",
    objects=(
        AnnotatedObject(id="o1", name="Shell", kind="marker_box", stream="color"),
        AnnotatedObject(id="o2", name="Pepsi", kind="marker_box", stream="color"),
        AnnotatedObject(id="o3", name="Performer", kind="rig"),
        AnnotatedObject(
            id="o4",
            name="table",
            kind="rectangle",
            key_frames=(
                KeyFrame(frame=-1, coordinates=(0.0, 0.0, 9.0, 9.0)),
                KeyFrame(frame=50, present=False),
            ),
        ),
    ),
    events=(
        Event(
            id="a1",
            type="slide",
            tier="event",
            text="Slide Shell past Pepsi",
            segments=(Segment(start_frame=-1, end_frame=60), Segment(start_frame=80, end_frame=N_FRAMES)),
            roles=(
                Role(name="theme", target="o1"),
                Role(name="hand", target="o3/HandRight", kind="joint"),
            ),
            links=(Link(type="CAUSE", target="a2"),),
            references=(
                TextReference(start=6, end=11, target="o1"),
                TextReference(start=17, end=22, target="o2"),
            ),
        ),
        Event(id="a2", tier="sub-event", parent="a1", segments=(Segment(start_frame=10, end_frame=20),)),
    ),
    relations=(
        Relation(
            predicate="SUPPORT", start_frame=0, arguments=(Argument(target="o4"), Argument(target="o1"))
        ),
        Relation(
            predicate="SUPPORT", start_frame=3, arguments=(Argument(target="o4"), Argument(target="Other/o7"))
        ),
        Relation(predicate="STAND", start_frame=5, end_frame=9, arguments=(Argument(target="o3"),)),
    ),
)

_COLOR = Camera(
    name="color",
    width_px=1920,
    height_px=1080,
    fx_px=1060.0,
    fy_px=1060.0,
    cx_px=960.0,
    cy_px=540.0,
    reference="depth",
)
MANIFEST = Manifest(
    name="healthy",
    created="2026-01-01T00:00:00Z",
    n_frames=N_FRAMES,
    clock=Clock(rule="recorded", duration_ns=(N_FRAMES - 1) * PERIOD_NS),
    cameras=(
        _COLOR,
        replace(_COLOR, name="depth", reference=""),
    ),
    streams=(
        Stream(name="color", kind="color", camera="color", n_frames=N_FRAMES),
        Stream(name="depth", kind="depth", camera="depth", n_frames=N_FRAMES),
    ),
)


def make_table(name: str, columns: Mapping[str, Any]) -> pa.Table:
    """A table of the schema ``name``; columns that are not given are empty."""
    schema = TABLES[name].arrow
    n = len(next(iter(columns.values())))
    arrays = [pa.array(columns.get(f.name, [None] * n), from_pandas=True).cast(f.type) for f in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def frames_table() -> pa.Table:
    """Two streams at 30 frames per second, depth 4 ms behind colour."""
    frame = np.repeat(np.arange(N_FRAMES), 2)
    late = np.tile([0, 4_000_000], N_FRAMES)
    return make_table(
        "frames", {"t_ns": frame * PERIOD_NS + late, "frame": frame, "stream": ["color", "depth"] * N_FRAMES}
    )


def marks_table(name: str) -> pa.Table:
    """Two boxes with one face each, seen in every frame; o1 slides at 0.3 m/s (3 pixels per frame)."""
    frame = np.repeat(np.arange(N_FRAMES), 2)
    u = np.where(np.arange(2 * N_FRAMES) % 2 == 0, 400.0 + 3 * frame, 1200.0)
    square = np.array([(0, 0), (60, 0), (60, 60), (0, 60)])
    columns: dict[str, Any] = {
        "t_ns": frame * PERIOD_NS,
        "frame": frame,
        "object_id": ["o1", "o2"] * N_FRAMES,
        "order": np.zeros_like(frame),
        "present": np.ones(len(frame), dtype=bool),
        "glyph_size": np.full_like(frame, 5),
        "code": ["10111" * 5, "01111" * 5] * N_FRAMES,
    }
    for i, (du, dv) in enumerate(square):
        if name == "markers_2d":
            columns |= {f"u{i}_px": u + du, f"v{i}_px": np.full(len(u), 500.0 + dv)}
        else:
            columns |= {
                f"x{i}": (u + du) / 1000,
                f"y{i}": np.full(len(u), dv / 1000),
                f"z{i}": np.full(len(u), 1.0),
            }
    return make_table(name, columns)


def poses_table() -> pa.Table:
    """Both boxes in every frame; o1 slides at 0.3 m/s."""
    frame = np.repeat(np.arange(N_FRAMES), 2)
    n = len(frame)
    x = np.where(np.arange(n) % 2 == 0, 0.01 * frame, 1.0)
    zero = np.zeros(n)
    columns = {"t_ns": frame * PERIOD_NS, "frame": frame, "object_id": ["o1", "o2"] * N_FRAMES}
    pose = {"x": x, "y": zero, "z": zero + BOX_M / 2, "qx": zero, "qy": zero, "qz": zero, "qw": zero + 1}
    return make_table("poses", columns | pose | {"source": ["observed"] * n, "support": ["table"] * n})


@dataclass
class Case:
    """Everything a patient is made of, to be changed at will before ``patient`` is asked for."""

    manifest: Manifest = MANIFEST
    layer: Layer = LAYER
    tables: dict[str, pa.Table] = field(default_factory=dict[str, pa.Table])
    schemes: dict[str, CodingScheme] = field(default_factory=lambda: {"boxes": SCHEME})
    siblings: dict[str, frozenset[str]] = field(default_factory=lambda: {"Other": frozenset({"o7"})})

    @property
    def patient(self) -> Patient:
        """The patient as the checks see it."""
        return Patient(
            manifest=self.manifest,
            layers={self.layer.name: self.layer},
            table=self.tables.get,
            scheme=self.schemes.get,
            sibling=self.siblings.get,
        )

    def change(self, name: str, edit: Callable[[dict[str, Any]], None]) -> None:
        """Let ``edit`` change the columns (lists) of a table."""
        columns: dict[str, Any] = self.tables[name].to_pydict()
        edit(columns)
        self.tables[name] = make_table(name, columns)

    def keep(self, name: str, keep: Callable[[dict[str, Any]], bool]) -> None:
        """Keep the rows of a table for which ``keep`` holds."""
        rows = [row for row in self.tables[name].to_pylist() if keep(row)]
        self.tables[name] = make_table(
            name, {key: [row[key] for row in rows] for key in self.tables[name].column_names}
        )

    def change_event(self, index: int, **fields: Any) -> None:
        """Change fields of one event."""
        events = list(self.layer.events)
        events[index] = replace(events[index], **fields)
        self.layer = replace(self.layer, events=tuple(events))

    def change_relation(self, index: int, **fields: Any) -> None:
        """Change fields of one relation."""
        relations = list(self.layer.relations)
        relations[index] = replace(relations[index], **fields)
        self.layer = replace(self.layer, relations=tuple(relations))


@pytest.fixture
def case() -> Case:
    """A recording of four seconds with two boxes, without any disease."""
    names = ("markers_2d", "markers_3d")
    tables = {"frames": frames_table(), "poses": poses_table()} | {name: marks_table(name) for name in names}
    return Case(tables=tables)
