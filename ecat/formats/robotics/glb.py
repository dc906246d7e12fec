"""The scene at a moment as GLB (binary glTF 2.0), which browsers, Blender and trimesh open.

Source: https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html.  Metres; the root turns ``table`` (z up) to glTF's y
up.  Carried: a node for each block with its name, size, colour and pose, for the table, for each body, and for the
points from depth with their colours; session, frame and time as ``extras``.  Left behind: all but one moment.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from io import BufferedWriter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.formats.format import Format
from ecat.formats.robotics.still import Solid, Still, StillOptions, still
from ecat.geometry.transforms import Floats, Rigid
from ecat.progress import Progress
from ecat.store import Session, files

_TO_Y_UP = {"table": [-(0.5**0.5), 0.0, 0.0, 0.5**0.5], "camera/depth": [1.0, 0.0, 0.0, 0.0]}
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_TYPES = {"<f4": 5126, "<u4": 5125}
_POINTS, _TRIANGLES = 0, 4
_JSON, _BIN = b"JSON", b"BIN\0"
_UNLIT = "KHR_materials_unlit"


def part(
    session: Session, label: str, dest: Path, options: StillOptions, progress: Progress
) -> tuple[str, ...]:
    """Write the scene at a moment; errors as of :func:`ecat.formats.robotics.still.still`."""
    progress(f"writing {label}", 0, 1)
    scene = still(session, label, options)
    with BufferedWriter(files.NewFile(dest)) as out:
        out.write(glb_bytes(scene, session.name))
    return scene.findings


@dataclass
class _Document:
    """A glTF document while it is being made."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    accessors: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    meshes: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    materials: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    nodes: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])

    def accessor(self, values: NDArray[Any], kind: str, shape: str, target: int, **more: Any) -> int:
        """Numbers in the buffer, ``kind`` their little-endian type."""
        raw = np.ascontiguousarray(values, kind).tobytes()
        self.views.append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw), "target": target}
        )
        self.data += raw + bytes(-len(raw) % 4)
        view, count = len(self.views) - 1, len(values)
        self.accessors.append(
            {"bufferView": view, "componentType": _TYPES[kind], "count": count, "type": shape, **more}
        )
        return len(self.accessors) - 1

    def positions(self, points: Floats) -> int:
        """Places (n, 3), with the bounds that glTF asks for."""
        single = points.astype("<f4")
        low, high = single.min(0).tolist(), single.max(0).tolist()
        return self.accessor(single, "<f4", "VEC3", _ARRAY_BUFFER, min=low, max=high)

    def node(self, name: str, primitive: dict[str, Any], place: Rigid, material: dict[str, Any]) -> None:
        """A thing with a place of its own."""
        self.materials.append({"name": name, **material})
        self.meshes.append({"name": name, "primitives": [{**primitive, "material": len(self.materials) - 1}]})
        self.nodes.append(
            {
                "name": name,
                "mesh": len(self.meshes) - 1,
                "translation": place.translation.tolist(),
                "rotation": place.quaternion.tolist(),
            }
        )

    def solid(self, solid: Solid) -> None:
        """Triangles of one colour, seen from both sides."""
        indices = self.accessor(solid.faces.ravel(), "<u4", "SCALAR", _ELEMENT_BUFFER)
        primitive = {
            "attributes": {"POSITION": self.positions(solid.vertices)},
            "indices": indices,
            "mode": _TRIANGLES,
        }
        color = [*_linear(np.array(solid.color)).tolist(), 1.0]
        surface = {"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 0.9}
        self.node(solid.name, primitive, solid.place, {"pbrMetallicRoughness": surface, "doubleSided": True})

    def points(self, points: Floats, colors: NDArray[np.uint8]) -> None:
        """Points with their colours, which no light changes."""
        color = self.accessor(_linear(colors), "<f4", "VEC3", _ARRAY_BUFFER)
        primitive = {"attributes": {"POSITION": self.positions(points), "COLOR_0": color}, "mode": _POINTS}
        self.node("points", primitive, Rigid.identity(), {"extensions": {_UNLIT: {}}})


def glb_bytes(scene: Still, session: str) -> bytes:
    """The file."""
    made = _Document()
    for solid in scene.solids:
        made.solid(solid)
    if len(scene.points):
        made.points(scene.points, scene.colors)
    n = len(made.nodes)
    root = {"name": scene.reference, "rotation": _TO_Y_UP[scene.reference], "children": list(range(n))}
    extras = {"session": session, "frame": scene.frame, "t_ns": scene.t_ns, "reference": scene.reference}
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "ecat"},
        "scene": 0,
        "scenes": [{"name": session, "nodes": [n], "extras": extras}],
        "nodes": [*made.nodes, root],
        "meshes": made.meshes,
        "materials": made.materials,
        "accessors": made.accessors,
        "bufferViews": made.views,
        "buffers": [{"byteLength": len(made.data)}],
    }
    if len(scene.points):
        document["extensionsUsed"] = [_UNLIT]
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
    chunks = _chunk(_JSON, text + b" " * (-len(text) % 4)) + _chunk(_BIN, bytes(made.data))
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack("<I4s", len(data), kind) + data


def _linear(rgb: NDArray[Any]) -> Floats:
    """SRGB (..., 3) from 0 to 255 as the linear light that glTF asks for, 0 to 1 (IEC 61966-2-1)."""
    value = rgb / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


FORMAT = Format(
    name="glb",
    description="the scene at a moment as GLB (glTF 2.0): table, blocks and bodies by name, coloured points",
    part=part,
    suffix=".glb",
    options=StillOptions,
)
