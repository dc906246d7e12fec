"""The truth about every image as tables: when it was taken, and where everything was at that moment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.geometry.transforms import Floats
from ecat.progress import Progress, silent
from ecat.sample.pixels.renderer import Renderer

Times = Mapping[str, NDArray[np.int64]]
"""Name of a stream, which is that of its camera -> when its images are taken (n,), nanoseconds."""


def moments(renderer: Renderer, t_ns: NDArray[np.int64]) -> Floats:
    """Frames (n,) of the truth, with fractions, at times (n,): it has equal steps."""
    clock, n = renderer.truth.clock, renderer.truth.n_frames
    return np.asarray(t_ns, float) * (n - 1) / (clock.duration_ns or 1)


def image_truth(renderer: Renderer, times: Times, *, progress: Progress = silent) -> dict[str, pa.Table]:
    """The tables ``image_poses`` and ``image_faces``, rows by stream and image, and ``cameras``.

    Poses are in the ``table`` frame; ``camera_poses`` of ``cameras`` take points of the ``table`` frame to the camera's
    own.  ``visible`` is the share of a marker that is to be seen: see :class:`ecat.sample.pixels.SeenFaces`.
    """
    truth, poses, faces = renderer.truth, list[dict[str, Any]](), list[dict[str, Any]]()
    total, done = sum(len(t_ns) for t_ns in times.values()), 0
    for stream, t_ns in times.items():
        for image, (t, frame) in enumerate(zip(t_ns.tolist(), moments(renderer, t_ns).tolist(), strict=True)):
            progress("measuring what is to be seen", done, total)
            done += 1
            key = {"stream": stream, "image": image, "t_ns": t}
            boxes, _ = renderer.state(frame)
            seen = renderer.faces(frame, stream)
            for k, (object_id, box) in enumerate(zip(truth.object_ids, truth.prototypes, strict=True)):
                place, turn = boxes.translation[k].tolist(), boxes.quaternion[k].tolist()
                pose = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), [*place, *turn], strict=True))
                poses.append(key | {"object_id": object_id} | pose)
                for j, face in enumerate(box.faces):
                    corners = {
                        f"{axis}{i}_px": float(seen.pixels[k, j, i, a])
                        for i in range(4)
                        for a, axis in enumerate("uv")
                    }
                    measured = {
                        "side_px": float(seen.side_px[k, j]),
                        "tilt_rad": float(seen.tilt_rad[k, j]),
                        "visible": float(seen.visible[k, j]),
                    }
                    faces.append(key | {"object_id": object_id, "face": face.face} | measured | corners)
    tables = {"image_poses": poses, "image_faces": faces, "cameras": _cameras(renderer)}
    return {name: pa.Table.from_pylist(rows) for name, rows in tables.items()}


def _cameras(renderer: Renderer) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for name, camera in renderer.cameras.items():
        pose = camera.from_reference @ renderer.truth.scene.depth_from_table
        place = dict(zip(("x", "y", "z"), pose.translation.tolist(), strict=True))
        turn = dict(zip(("qx", "qy", "qz", "qw"), pose.quaternion.tolist(), strict=True))
        size = {"width_px": camera.width, "height_px": camera.height, "mirrored": camera.mirrored}
        lens = {"fx_px": camera.fx, "fy_px": camera.fy, "cx_px": camera.cx, "cy_px": camera.cy}
        rows.append({"camera": name} | size | lens | place | turn)
    return rows
