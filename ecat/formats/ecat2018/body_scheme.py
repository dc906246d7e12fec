"""``bodyScheme.xml``: how to read a rig file, and the skeleton's joints and bones (§1.3).

The file says by simple paths where a rig file keeps what. It was written by hand: values are wrapped in
blanks and comments, loose text stands between elements, joints are listed alphabetically. All that is
accepted; a path may only name child elements and one attribute, so a scheme cannot make a reader search at
will.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ecat.errors import FormatError
from ecat.formats.ecat2018.lexical import attribute, text
from ecat.formats.ecat2018.number_text import parse_int
from ecat.formats.ecat2018.xml_input import (
    Element,
    parse_safe,
    place,
    reading,
    required_attribute,
    required_child,
)

MAX_BYTES = 1 << 20
MAX_JOINTS = 127
_STEP = r"[A-Za-z_][\w.\-]*"
_PATH = re.compile(rf"{_STEP}(?:/{_STEP})*(?:/@{_STEP})?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint; its id is its place in `BodyScheme.joints` and in the lists of a rig file."""

    name: str
    description: str = ""


@dataclass(frozen=True, slots=True)
class BodyScheme:
    """Where a rig file keeps what, and the skeleton.

    Paths are relative to the element of one body in one frame; ``sequence_root`` and ``frame_root`` are
    element names. ``bones`` are pairs of joint ids. ``time_from_begin_path`` is named by some files and used
    by none.
    """

    joints: tuple[Joint, ...]
    bones: tuple[tuple[int, int], ...]
    sequence_root: str = "BodyDataSequence"
    frame_root: str = "Body_Data"
    points_2d_path: str = "Skeleton_ImgPlane_Joint_Locations/Pts"
    points_3d_path: str = "Skeleton_Joint_Locations_Orig/Pts"
    counter_path: str = "Timestamp/@frame"
    time_path: str = "Timestamp/@time"
    body_path: str = "Subject/@id"
    time_from_begin_path: str | None = None


# field of BodyScheme -> element of rigPointInput
_PATHS = {
    "sequence_root": "sequenceRoot",
    "frame_root": "frameRoot",
    "points_2d_path": "rigPointsPath",
    "points_3d_path": "rigPoint3DsPath",
    "counter_path": "frameNoPath",
    "time_path": "frameTimePath",
    "body_path": "rigNoPath",
}


def read_body_scheme(source: Path | bytes) -> BodyScheme:
    """Read a scheme.

    Raises ------ FormatError : not a scheme of the flat XML kind, a path that is more than names, joint ids
    with gaps, or a bone
        without its joints.
    LimitError : above 1 MiB.
    """
    what = reading(source, "the body scheme")
    root = parse_safe(source, what=what, max_bytes=MAX_BYTES)
    if root.tag != "rigFormat":
        raise FormatError(
            what, where=f"line {root.sourceline}: the root is <{root.tag}>, expected <rigFormat>"
        )
    points = required_child(root, "rigPointInput", what=what)
    kind = required_child(points, "inputType", what=what)
    layout = required_child(points, "rigPointFormat", what=what)
    if (kind.text or "").strip() != "xml" or (layout.get("type"), layout.get("separated")) != ("flat", ","):
        raise FormatError(
            what, where=f"{place(layout)}: only XML with flat lists separated by commas can be read"
        )
    paths = {field: _path(required_child(points, name, what=what), what) for field, name in _PATHS.items()}
    optional = points.find("timeFromBeginPath")
    joints = _joints(points, what)
    bones = root.iterfind("rigBoneFormat/rigBone")
    return BodyScheme(
        joints,
        tuple((_id(bone, "from", len(joints), what), _id(bone, "to", len(joints), what)) for bone in bones),
        time_from_begin_path=None if optional is None else _path(optional, what),
        **paths,
    )


def _path(element: Element, what: str) -> str:
    path = (element.text or "").strip()
    if not _PATH.fullmatch(path):
        raise FormatError(what, where=f"{place(element)}: {path[:60]!r} is not a path of element names")
    return path


def _joints(points: Element, what: str) -> tuple[Joint, ...]:
    elements = list(points.iterfind(".//rigPoint"))
    if not 0 < len(elements) <= MAX_JOINTS:
        raise FormatError(what, where=f"{place(points)}: {len(elements)} joints, expected 1 to {MAX_JOINTS}")
    found = {
        _id(element, "id", len(elements), what): Joint(
            required_attribute(element, "name", what=what), element.get("description", "")
        )
        for element in elements
    }
    if len(found) < len(elements) or len({joint.name for joint in found.values()}) < len(elements):
        raise FormatError(what, where=f"{place(points)}: two joints share an id or a name")
    return tuple(found[i] for i in range(len(found)))


def _id(element: Element, name: str, count: int, what: str) -> int:
    value = required_attribute(element, name, what=what)
    return parse_int(value, what=what, where=f"{place(element)} {name}", low=0, high=count - 1)


def write_body_scheme(scheme: BodyScheme) -> bytes:
    """The scheme in a plain layout, joints by id; `read_body_scheme` reads it back equal."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<rigFormat>", "\t<rigPointInput>"]
    lines.append("\t\t<inputType>xml</inputType>")
    lines += [f"\t\t<{name}>{text(getattr(scheme, field))}</{name}>" for field, name in _PATHS.items()]
    if scheme.time_from_begin_path is not None:
        lines.append(f"\t\t<timeFromBeginPath>{text(scheme.time_from_begin_path)}</timeFromBeginPath>")
    lines += ['\t\t<rigPointFormat type="flat" separated="," />', "\t\t<rigPoints>"]
    for i, joint in enumerate(scheme.joints):
        names = attribute("name", joint.name) + attribute("id", str(i))
        lines.append(f"\t\t\t<rigPoint{names}{attribute('description', joint.description)} />")
    lines += ["\t\t</rigPoints>", "\t</rigPointInput>", "\t<rigBoneFormat>"]
    for i, (start, end) in enumerate(scheme.bones):
        lines.append(f'\t\t<rigBone id="{i}" from="{start}" to="{end}" />')
    return "\n".join([*lines, "\t</rigBoneFormat>", "</rigFormat>", ""]).encode()


_SIDED = ("Shoulder", "Elbow", "Wrist", "Hand")
_LEGS = ("Hip", "Knee", "Ankle", "Foot")
_NAMES = (
    *("SpineBase", "SpineMid", "Neck", "Head"),
    *(part + side for parts in (_SIDED, _LEGS) for side in ("Left", "Right") for part in parts),
    *("SpineShoulder", "HandTipLeft", "ThumbLeft", "HandTipRight", "ThumbRight"),
)


def _description(name: str) -> str:
    special = {
        "SpineBase": "Base of the spine",
        "SpineMid": "Middle of the spine",
        "SpineShoulder": "Spine at the shoulder",
    }
    side = "left" if name.endswith("Left") else "right"
    part = name.removesuffix("Left").removesuffix("Right")
    if part == name:
        return special.get(name, name)
    return f"Tip of the {side} hand" if part == "HandTip" else f"{side.capitalize()} {part.lower()}"


KINECT_V2 = BodyScheme(
    joints=tuple(Joint(name, _description(name)) for name in _NAMES),
    bones=(
        *((0, 1), (1, 20), (20, 2), (2, 3)),
        *((20, 4), (4, 5), (5, 6), (6, 7), (7, 21), (7, 22)),
        *((20, 8), (8, 9), (9, 10), (10, 11), (11, 23), (11, 24)),
        *((0, 12), (12, 13), (13, 14), (14, 15)),
        *((0, 16), (16, 17), (17, 18), (18, 19)),
    ),
)
"""The scheme of every recording made with ECAT: 25 Kinect joints, 24 bones."""
