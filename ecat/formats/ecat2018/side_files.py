"""What ``ecat info`` says about the files of ECAT 2018 that are no session (ECAT 2018 file format §1).

XML is known by its root element, whatever its name; everything else by its name.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from ecat.errors import FormatError
from ecat.formats.ecat2018.body_scheme import read_body_scheme
from ecat.formats.ecat2018.coordinate_mapping import read_coordinate_mapping
from ecat.formats.ecat2018.depth_file import DepthFile
from ecat.formats.ecat2018.glyphs import GLYPHS, identify, mirror, read_glyph
from ecat.formats.ecat2018.learning_export import LABELS, read_learning_export
from ecat.formats.ecat2018.options import read_options
from ecat.formats.ecat2018.program_params import read_program_params
from ecat.formats.ecat2018.project_list import read_project_list
from ecat.formats.ecat2018.rig import iter_rig
from ecat.formats.ecat2018.voxml import read_voxml
from ecat.formats.format import SideFile

Facts = Mapping[str, object]
_HEAD_BYTES = 4096
_ROOT = re.compile(rb"(?:\xef\xbb\xbf)?\s*(?:<\?[^>]*>\s*|<!--.*?-->\s*)*<([A-Za-z]\w*)", re.DOTALL)
_EXPORT = re.compile(rb"<project>\s*<session\b|<project\s*/>|<project>\s*</project>")
_MOST_FINDINGS = 20


# ---------------------------------------------------------------------------------------------- by sight


def head_of(path: Path) -> bytes:
    """The first bytes of a regular file; none where it cannot be read."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except OSError:
        return b""


def is_learning_export(path: Path) -> bool:
    """Whether the file begins as an event export does."""
    head = head_of(path)
    return _root(head) == "project" and _EXPORT.search(head) is not None


def _root(head: bytes) -> str:
    """The name of the root element, or nothing."""
    found = _ROOT.match(head)
    return found[1].decode() if found else ""


def _xml(root: str, pattern: str = "") -> Callable[[Path], bool]:
    """By the root element; by the name only where there is none, so that the error can say what is wrong."""

    def sniff(path: Path) -> bool:
        head = head_of(path)
        return _root(head) == root or (bool(head) and not _root(head) and _called(pattern)(path))

    return sniff


def _called(pattern: str) -> Callable[[Path], bool]:
    return lambda path: path.is_file() and fnmatchcase(path.name.lower(), pattern)


# ---------------------------------------------------------------------------------------------- what they hold


def _options(path: Path) -> Facts:
    options = read_options(path)
    return {
        "detection_mode": options.detection_mode,
        "glyph_prototype_path": options.glyph_prototype_path,
        "show_markers": options.show_markers,
        "show_rig": options.show_rig,
        "interpolation": dict(options.interpolation_modes),
        "object_predicates": [str(form) for form in options.object_predicates],
        "event_predicates": [str(form) for form in options.event_predicates],
        "constraints": [str(constraint) for constraint in options.constraints],
    }


def _mapping(path: Path) -> Facts:
    mapping = read_coordinate_mapping(path)
    height, width = mapping.near_px.shape[:2]
    u, v = width // 2, height // 2
    unknown = int(np.isnan(mapping.near_px).any(axis=2).sum())
    seen = mapping.to_colour(u, v, [mapping.near_mm, mapping.far_mm]).round(1).tolist()
    return {
        "width_px": width,
        "height_px": height,
        "near_mm": mapping.near_mm,
        "far_mm": mapping.far_mm,
        "pixels_without_mapping": unknown,
        "colour_pixel_of_the_centre": [
            {"depth_mm": depth, "u_px": _number(at[0]), "v_px": _number(at[1])}
            for depth, at in zip((mapping.near_mm, mapping.far_mm), seen, strict=True)
        ],
    }


def _voxml(path: Path) -> Facts:
    entry = read_voxml(path)
    return {
        "predicate": entry.lex.pred,
        "types": list(entry.lex.types),
        "head": entry.type.head,
        "components": list(entry.type.components),
        "concavity": entry.type.concavity,
        "rotational_symmetry": list(entry.type.rotational_symmetry),
        "reflectional_symmetry": list(entry.type.reflectional_symmetry),
        "intrinsic_habitat": [{"name": name, "value": value} for name, value in entry.habitat.intrinsic],
        "extrinsic_habitat": [{"name": name, "value": value} for name, value in entry.habitat.extrinsic],
        "affordances": list(entry.affordances),
        "scale": entry.embodiment.scale,
        "movable": entry.embodiment.movable,
        "used_by_ecat_2018": entry.used_by_ecat,
        "other_elements": [xml for _, xml in entry.unknown],
    }


def _params(path: Path) -> Facts:
    params = read_program_params(path)
    return {
        "default_workspace": params.default_workspace,
        "recent_workspaces": list(params.recent_workspaces),
    }


def _glyph(path: Path) -> Facts:
    cells = read_glyph(path)
    known = identify(cells)
    box, face = GLYPHS[known.id] if known is not None else (None, None)
    return {
        "aruco_original_id": known.id if known is not None else None,
        "box": box,
        "face": face,
        "as_printed": ["".join("#" if cell else "." for cell in row) for row in cells.tolist()],
        "as_a_mirrored_image_shows_it": [
            "".join("#" if cell else "." for cell in row) for row in mirror(cells).tolist()
        ],
    }


def _scheme(path: Path) -> Facts:
    scheme = read_body_scheme(path)
    names = [joint.name for joint in scheme.joints]
    return {
        "records": f"{scheme.sequence_root}/{scheme.frame_root}",
        "joints": names,
        "bones": [f"{names[start]} - {names[end]}" for start, end in scheme.bones],
    }


def _rig(path: Path) -> Facts:
    records, bodies, findings = 0, Counter[int](), list[str]()
    first: list[dict[str, Any]] = []
    last: list[dict[str, Any]] = []
    try:
        for batch in iter_rig(path):
            begins = np.flatnonzero(np.diff(batch["record"].to_numpy(), prepend=-1))
            rows = batch.select(["t_ns", "recorded_at", "counter", "body"]).take(begins).to_pylist()
            records += len(rows)
            bodies.update(row["body"] for row in rows)
            first, last = first or rows[:1], rows[-1:]
    except FormatError as error:
        if not records:
            raise
        findings.append(f"the file is damaged, {records} records before it can be read: {error.where}")
    times = [row["t_ns"] for row in (*first, *last) if row["t_ns"] is not None]
    return {
        "records": records,
        "duration_s": (times[1] - times[0]) / 1e9 if len(times) == 2 else None,
        "recorded_at": str(first[0]["recorded_at"]) if first and first[0]["recorded_at"] else None,
        "colour_images_counted": last[0]["counter"] if last else None,
        "bodies": [{"body": f"slot {slot}", "records": n} for slot, n in sorted(bodies.items())],
        "findings": findings,
    }


def _depth(path: Path) -> Facts:
    with DepthFile(path) as depth:
        times = depth.times_ms
        span = None if times is None or not len(times) else (int(times.max()) - int(times.min())) / 1000
        return {
            "width_px": depth.width,
            "height_px": depth.height,
            "frames": len(depth),
            "unit": "1 mm, 0 = no measurement",
            "duration_s": span,
            "findings": list(depth.findings[:_MOST_FINDINGS]),
        }


def _export(path: Path) -> Facts:
    rows: list[dict[str, object]] = []
    labels: dict[str, set[str]] = {name: set() for name in LABELS}
    frames, events, findings = 0, 0, list[str]()
    for session in read_learning_export(path):
        n = len(np.unique(session.joints["frame"]))
        frames, events = frames + n, events + session.events.num_rows
        rows.append({"name": session.name, "frames": n, "events": session.events.num_rows})
        findings += [f"{session.name}: {finding}" for finding in session.findings]
        for name, seen in labels.items():
            seen |= {str(label) for label in session.events[name].to_pylist() if label is not None}
    return {
        "frames": frames,
        "events": events,
        "labels": {name: ", ".join(sorted(seen)) for name, seen in labels.items()},
        "sessions": rows,
        "findings": findings[:_MOST_FINDINGS],
    }


def _list(path: Path) -> Facts:
    return {"sessions": list(read_project_list(path).names)}


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None


SIDE_FILES = (
    SideFile(
        name="ecat-2018 options",
        description="settings of ECAT 2018: its predicates, which exclude each other, how shapes are interpolated",
        sniff=_xml("Options", "option.txt"),
        explain=_options,
    ),
    SideFile(
        name="ecat-2018 learning export",
        description="event export of ECAT 2018: a skeleton, two boxes and labelled windows; `ecat import` reads it",
        sniff=is_learning_export,
        explain=_export,
    ),
    SideFile(
        name="VoxML entry",
        description="what a thing is shaped like, how it stands, what it affords",
        sniff=_xml("VoxML"),
        explain=_voxml,
    ),
    SideFile(
        name="ecat-2018 program settings",
        description="the workspaces that ECAT 2018 knew",
        sniff=_xml("ws", "params.param"),
        explain=_params,
    ),
    SideFile(
        name="ecat-2018 body scheme",
        description="how ECAT 2018 read skeletons: joints, bones, and where they stand in a rig file",
        sniff=_xml("rigFormat", "bodyscheme*.xml"),
        explain=_scheme,
    ),
    SideFile(
        name="ecat-2018 rig",
        description="skeletons that ECAT's recorder saved; `ecat import` reads the folder it lies in",
        sniff=_xml("BodyDataSequence", "rig_*.xml"),
        explain=_rig,
    ),
    SideFile(
        name="ecat-2018 depth",
        description="depth images that ECAT's recorder saved; `ecat import` reads the folder it lies in",
        sniff=_called("*.dep"),
        explain=_depth,
    ),
    SideFile(
        name="ecat-2018 coordinate mapping",
        description="one Kinect's own table from depth pixels to colour pixels",
        sniff=_called("coordinatemapping*.dat"),
        explain=_mapping,
    ),
    SideFile(
        name="ecat-2018 glyph",
        description="the pattern of a marker; # is white",
        sniff=_called("*.glyph"),
        explain=_glyph,
    ),
    SideFile(
        name="ecat-2018 project list",
        description="the sessions that ECAT before July 2018 showed of a project",
        sniff=_called("*.project"),
        explain=_list,
    ),
)
"""In the order in which they are tried."""
