"""Sessions with videos, and what is found in them without looking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from ecat.geometry.cameras import KINECT_V2_DEPTH
from ecat.model import Stream
from ecat.sample import sample_session
from ecat.sample.truth import GroundTruth
from ecat.stages import STAGES
from ecat.stages.images import ImagesByKind
from ecat.stages.stage import Tables
from ecat.store import create_session
from ecat.store.media import ColorWriter, DepthWriter

BLACK = np.zeros((16, 16, 3), np.uint8)


def filmed(
    path: Path, seed: int, *, with_depth: bool = False, eyeless: bool = False
) -> tuple[GroundTruth, pa.Table]:
    """Make a sample session with a black video in place of its markers; the truth, and the markers.

    ``with_depth``: with depth images of the bare table; ``eyeless``: so, and nothing known of the colour camera.
    """
    draft, truth = sample_session(seed=seed, actions=("next",), name=path.name)
    markers = draft.tables["markers_2d"].data
    assert isinstance(markers, pa.Table)
    times = (truth.t_ns // 1000 * 1000).tolist()

    def color(file: Path) -> None:
        with ColorWriter(file, 16, 16) as writer:
            for t_ns in times:
                writer.write(BLACK, t_ns)

    def depth(file: Path) -> None:
        image = bare_table(truth)
        with DepthWriter(file, *image.shape[::-1]) as writer:
            for t_ns in times[:12]:
                writer.write(image, t_ns)

    streams = (
        Stream(name="color", kind="color", file="media/color.mp4", codec="h264", camera="color"),
        Stream(name="depth", kind="depth", file="media/depth.mkv", camera="depth", depth_unit_m=0.001),
    )
    manifest = replace(draft.manifest, streams=streams[: 2 if eyeless or with_depth else 1])
    if eyeless:
        known = tuple(camera for camera in manifest.cameras if camera.name == "depth")
        manifest = replace(manifest, cameras=known)
    media = {"color": color, "depth": depth}
    media = {stream.name: media[stream.name] for stream in manifest.streams}
    create_session(path, replace(draft, manifest=manifest, tables={}, media=media, layers=()))
    return truth, markers


def bare_table(truth: GroundTruth) -> NDArray[np.uint16]:
    """What a depth camera measures of a square metre of the table, in millimetres."""
    camera, table = KINECT_V2_DEPTH, truth.scene.depth_from_table
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1).reshape(-1, 2)
    rays = camera.unproject(pixels.astype(float))
    normal = table.rotation[:, 2]
    points = rays * ((normal @ table.translation) / (rays @ normal))[:, None]
    on_table = (np.abs(table.inverse().apply(points)[:, :2]) < 0.5).all(1)
    depth_mm = np.where(on_table, 1000 * points[:, 2], 0.0)
    return np.rint(depth_mm).astype(np.uint16).reshape(camera.height, camera.width)


def find(monkeypatch: pytest.MonkeyPatch, marks: Sequence[pa.Table]) -> list[int]:
    """Let the stage that looks for marks find these, one table for each length of video; the lengths it looked at."""
    by_length = {int(np.asarray(table["frame"]).max()): table for table in marks}
    looked_at: list[int] = []

    def run(tables: Tables, images: ImagesByKind, parameters: object) -> dict[str, pa.Table]:
        del tables, parameters
        looked_at.append(len(images["color"]))
        # the last frame with marks may be a little before the end
        last = max(frame for frame in by_length if frame < looked_at[-1])
        return {"markers_2d": by_length[last]}

    stages = tuple(replace(stage, run=run) if stage.name == "track" else stage for stage in STAGES)
    monkeypatch.setattr("ecat.stages.STAGES", stages)
    return looked_at
