"""The scene at a moment as PLY, which MeshLab, Blender, Open3D and trimesh open.

Source: Turk, The PLY polygon file format, 1994.  Binary, metres, in ``table`` with z up, or in ``camera/depth`` where
no table is known.  Carried: table, blocks, bodies as triangles with a colour at each vertex; points from depth as
vertices without triangles, after them.  Left behind: names (all solids are one mesh), and all but one moment.
"""

from __future__ import annotations

from io import BufferedWriter
from pathlib import Path

import numpy as np

from ecat.formats.format import Format
from ecat.formats.robotics.still import Still, StillOptions, still
from ecat.progress import Progress
from ecat.store import Session, files

_VERTEX = np.dtype([("place", "<f4", 3), ("color", "u1", 3)])
_FACE = np.dtype([("n", "u1"), ("vertices", "<i4", 3)])


def part(
    session: Session, label: str, dest: Path, options: StillOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the scene at a moment; errors as of :func:`ecat.formats.robotics.still.still`."""
    progress(f"writing {label}", 0, 1)
    scene = still(session, label, options)
    with BufferedWriter(files.NewFile(dest)) as out:
        out.write(ply_bytes(scene))
    return scene.findings


def ply_bytes(scene: Still) -> bytes:
    """The file."""
    places = [solid.place.apply(solid.vertices) for solid in scene.solids] + [scene.points]
    colors = [
        np.tile(np.array(solid.color, np.uint8), (len(solid.vertices), 1)) for solid in scene.solids
    ] + [scene.colors]
    starts = np.cumsum([0, *map(len, places)])
    triangles = [solid.faces + start for solid, start in zip(scene.solids, starts, strict=False)]
    vertices = np.zeros(starts[-1], _VERTEX)
    vertices["place"], vertices["color"] = np.concatenate(places), np.concatenate(colors)
    faces = np.zeros(sum(map(len, triangles)), _FACE)
    if triangles:
        faces["n"], faces["vertices"] = 3, np.concatenate(triangles)
    moment = "" if scene.t_ns is None else f", {scene.t_ns} ns since the session's start"
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment metres, frame of reference: {scene.reference}",
        f"comment frame {scene.frame}{moment}",
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {channel}" for channel in ("red", "green", "blue")),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    return "\n".join([*head, ""]).encode() + vertices.tobytes() + faces.tobytes()


FORMAT = Format(
    name="ply",
    description="the scene at a moment as PLY: table, blocks, bodies, coloured points from depth",
    part=part,
    suffix=".ply",
    options=StillOptions,
)
