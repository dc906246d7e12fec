"""A small session on disk: one marked box on a table, one event, one relation."""

from __future__ import annotations

import re
from pathlib import Path

import pyarrow as pa
import pytest

from ecat.model import AnnotatedObject, Camera, Clock, Event, KeyFrame, Layer, Manifest, Relation, Segment
from ecat.model.annotation import Argument
from ecat.sample.scene import BOXES
from ecat.store import Draft, Session, TableData, create_session
from tests.view.chunks import table

N_FRAMES = 6
_CORNERS = {f"{axis}{i}_px": [100.0 + i] * N_FRAMES for i in range(4) for axis in "uv"}
_CAMERA = Camera(
    name="color", width_px=1920, height_px=1080, fx_px=1000, fy_px=1000, cx_px=960, cy_px=540, mirrored=True
)


def _plane() -> pa.Table:
    """The table a metre before the camera, facing it."""
    place = {name: [0.0] for name in ("origin_x", "origin_y", "qy", "qz", "qw")} | {
        "origin_z": [1.0],
        "qx": [1.0],
    }
    return table("table_plane", frame=[0], n_points=[9], n_inliers=[9], evidence=["polygon"], **place)


def draft() -> Draft:
    """The box is lifted at frame 2 and out of sight at frame 4."""
    frames = list(range(N_FRAMES))
    clock = Clock(rule="uniform", duration_ns=500_000_000)
    seen: list[float | None] = [None if frame == 4 else 0.1 for frame in frames]
    turn: list[float | None] = [None if frame == 4 else 1.0 for frame in frames]
    flat: list[float | None] = [None if frame == 4 else 0.0 for frame in frames]
    times = [clock.t_ns(frame, N_FRAMES) for frame in frames]
    usual = {"t_ns": times, "frame": frames, "object_id": ["o1"] * N_FRAMES}
    poses = table(
        "poses",
        **usual,
        **dict.fromkeys(("x", "y", "z"), seen),
        **dict.fromkeys(("qx", "qy", "qz"), flat),
        qw=turn,
        source=[None if frame == 4 else "observed" for frame in frames],
        support=["free" if frame == 2 else None if frame == 4 else "table" for frame in frames],
        residual_px=seen,
    )
    # as read in a mirrored image
    code = "".join(row[::-1] for row in re.findall(".....", BOXES[0].faces[0].code))
    marks = table(
        "markers_2d",
        **usual,
        **_CORNERS,
        order=[0] * N_FRAMES,
        present=[True] * N_FRAMES,
        code=[code] * N_FRAMES,
    )
    outline = KeyFrame(frame=0, coordinates=(0.0, 0.0, 100.0, 0.0, 100.0, 100.0))
    layer = Layer(
        objects=(
            AnnotatedObject(id="o1", name="Shell", kind="marker_box", dimensions=3),
            AnnotatedObject(id="o2", name="mat", kind="polygon", key_frames=(outline,)),
        ),
        events=(
            Event(id="a1", tier="event", text="Lift it", segments=(Segment(start_frame=1, end_frame=3),)),
        ),
        relations=(
            Relation(predicate="ON", start_frame=0, arguments=(Argument(target="o1"), Argument(target="o2"))),
        ),
    )
    manifest = Manifest(
        name="small session",
        created="2024-01-01T00:00:00",
        n_frames=N_FRAMES,
        clock=clock,
        cameras=(_CAMERA,),
        prototypes=(BOXES[0].to_dict(),),
    )
    tables = {"poses": poses, "markers_2d": marks, "table_plane": _plane()}
    return Draft(
        manifest=manifest,
        layers=(layer,),
        tables={name: TableData(data=data) for name, data in tables.items()},
    )


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return create_session(tmp_path / "small_session", draft())


@pytest.fixture
def bare(tmp_path: Path) -> Session:
    """A session of which nothing is known but that it was made."""
    return create_session(
        tmp_path / "bare", Draft(manifest=Manifest(name="bare", created="2024-01-01T00:00:00"))
    )
