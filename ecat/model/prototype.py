"""What is known of a marked box before a recording: its size, and which marker sits where on which face.

Box axes are right-handed with the origin in the box's centre; faces are named by their outward normal, in the
order of the original annotator's face index (ECAT 2018 file format §1.8): +x, -x, +y, -y, +z, -z.  A box that
lies as its prototype says has its +z face up.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, cast, get_args

from ecat.errors import SchemaError

FaceName: TypeAlias = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
FACES: tuple[FaceName, ...] = get_args(FaceName)
Triple: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
MOST_M = 10.0
"""Nobody handles a box with longer edges: lengths above are in other units."""

# box-from-marker rotations of a marker printed upright on each face: marker x right, y up, z out of the face
_h = math.sqrt(0.5)
UPRIGHT: dict[FaceName, Quaternion] = {
    "+x": (0.5, 0.5, 0.5, 0.5),
    "-x": (0.5, -0.5, -0.5, 0.5),
    "+y": (0.0, _h, _h, 0.0),
    "-y": (_h, 0.0, 0.0, _h),
    "+z": (0.0, 0.0, 0.0, 1.0),
    "-z": (1.0, 0.0, 0.0, 0.0),
}


@dataclass(frozen=True)
class MarkerFace:
    """A square marker on one face of a box.

    Parameters
    ----------
    face : the face that carries it.
    code : the printed pattern, row by row from its top left, '1' = white; a square number of cells.
    side_m : edge of the marker's outer (black) square.
    centre : marker's centre in box axes, metres.
    quaternion : x, y, z, w; rotation to box axes from marker axes (x right, y up on the print, z out of the
    face).
    sigma_m : standard deviation of the marker's position on the box; None for nominal values.
    """

    face: FaceName
    code: str
    side_m: float
    centre: Triple
    quaternion: Quaternion
    sigma_m: float | None = None


@dataclass(frozen=True)
class BoxPrototype:
    """A box with markers: ``size_m`` are the edge lengths along its x, y, z axes."""

    name: str
    size_m: Triple
    faces: tuple[MarkerFace, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, read back by ``from_dict``."""
        faces = [
            {
                "face": f.face,
                "code": f.code,
                "side_m": f.side_m,
                "centre": list(f.centre),
                "quaternion": list(f.quaternion),
                "sigma_m": f.sigma_m,
            }
            for f in self.faces
        ]
        return {"name": self.name, "size_m": list(self.size_m), "faces": faces}

    @classmethod
    def from_dict(cls, data: object) -> BoxPrototype:
        """Check and read what ``to_dict`` wrote.

        Raises
        ------
        SchemaError : with one problem per wrong field, each with its path.
        """
        problems: list[str] = []
        made = _box(data, problems)
        if problems:
            raise SchemaError(
                "cannot read the box prototype",
                problems=tuple(problems),
                consequence="no prototype was loaded",
                fix="calibrate the box again, or correct the fields named above",
            )
        return made


def _box(data: object, problems: list[str]) -> BoxPrototype:
    box = _mapping(data, "prototype", ("name", "size_m", "faces"), problems)
    name = box.get("name")
    if not isinstance(name, str) or not name:
        problems.append("name: expected a non-empty string")
    size = _numbers(box.get("size_m"), 3, "size_m", problems)
    if not all(0 < edge <= MOST_M for edge in size):
        problems.append(f"size_m: expected three positive lengths in metres, at most {MOST_M:g}")
    rows = box.get("faces")
    if not isinstance(rows, list) or not 0 < len(rows) <= len(FACES):
        found = f", found {len(rows):,}" if isinstance(rows, list) else ""
        problems.append(f"faces: expected a non-empty list of at most {len(FACES)} faces{found}")
        rows = []
    faces = tuple(_face(row, f"faces[{i}]", problems) for i, row in enumerate(cast("list[object]", rows)))
    for key in ("face", "code"):
        # texts: what is no face may not even be hashable
        seen = [str(getattr(f, key)) for f in faces]
        if len(set(seen)) < len(seen):
            problems.append(f"faces: the same {key} occurs twice")
    return BoxPrototype(str(name), cast("Triple", size), faces)


def _face(data: object, path: str, problems: list[str]) -> MarkerFace:
    row = _mapping(data, path, ("face", "code", "side_m", "centre", "quaternion"), problems)
    face, code, sigma = row.get("face"), row.get("code"), row.get("sigma_m")
    if face not in FACES:
        problems.append(f"{path}.face: expected one of {', '.join(FACES)}")
    if (
        not isinstance(code, str)
        or set(code) - {"0", "1"}
        or not code
        or math.isqrt(len(code)) ** 2 != len(code)
    ):
        problems.append(f"{path}.code: expected a square number of '0' and '1'")
    (side,) = _numbers([row.get("side_m")], 1, f"{path}.side_m", problems)
    if not 0 < side <= MOST_M:
        problems.append(f"{path}.side_m: expected a positive length in metres, at most {MOST_M:g}")
    centre = _numbers(row.get("centre"), 3, f"{path}.centre", problems)
    if max(map(abs, centre)) > MOST_M:
        problems.append(f"{path}.centre: expected a place on the box, at most {MOST_M:g} m from its centre")
    quaternion = _numbers(row.get("quaternion"), 4, f"{path}.quaternion", problems)
    if not math.isclose(math.hypot(*quaternion), 1.0, abs_tol=1e-6):
        problems.append(f"{path}.quaternion: expected a unit quaternion x, y, z, w")
    if sigma is not None and not (_is_number(sigma) and cast("float", sigma) >= 0):
        problems.append(f"{path}.sigma_m: expected null or a length in metres")
    return MarkerFace(
        cast("FaceName", face),
        str(code),
        side,
        cast("Triple", centre),
        cast("Quaternion", quaternion),
        float(cast("float", sigma)) if _is_number(sigma) else None,
    )


def _mapping(data: object, path: str, keys: Sequence[str], problems: list[str]) -> Mapping[str, object]:
    if not isinstance(data, Mapping):
        problems.append(f"{path}: expected an object")
        return {}
    row = cast("Mapping[str, object]", data)
    problems.extend(f"{path}.{key}: missing" for key in keys if key not in row)
    return row


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond all floats
        return False


def _numbers(value: object, n: int, path: str, problems: list[str]) -> tuple[float, ...]:
    items = cast("list[object]", value) if isinstance(value, list | tuple) else []
    if len(items) != n or not all(_is_number(x) for x in items):
        problems.append(f"{path}: expected {'a finite number' if n == 1 else f'{n} finite numbers'}")
        return (1.0,) + (0.0,) * (n - 1)
    return tuple(float(cast("float", x)) for x in items)


def face_normal(face: FaceName) -> Triple:
    """Outward normal of a face in box axes."""
    sign = 1.0 if face[0] == "+" else -1.0
    return cast("Triple", tuple(sign if axis == face[1] else 0.0 for axis in "xyz"))


def nominal_face(face: FaceName, code: str, side_m: float, size_m: Triple) -> MarkerFace:
    """A marker printed upright in the middle of a face of a box of the given size."""
    centre = tuple(n * edge / 2 for n, edge in zip(face_normal(face), size_m, strict=True))
    return MarkerFace(face, code, side_m, cast("Triple", centre), UPRIGHT[face])


def _glyph_box(name: str, codes: dict[FaceName, str]) -> BoxPrototype:
    # six-inch cubes; the markers measure 0.087-0.091 m in real recordings (ECAT 2018 file format §2.1)
    size = (0.1524, 0.1524, 0.1524)
    return BoxPrototype(
        name, size, tuple(nominal_face(f, c.replace("/", ""), 0.089, size) for f, c in codes.items())
    )


# The annotator's own boxes: ArUco "original" ids 5, 477, 71; 6, 566, 155; 426, 303, 521 (ECAT 2018 file
# format
# §1.8).  These are its tables, not measurements: in the real recordings Shell lies with 521 on top.
STELLA_ARTOIS = _glyph_box(
    "Stella Artois",
    {
        "+z": "11111/00000/11000/11000/11000",
        "-y": "10101/01010/11111/11111/10101",
        "+x": "01111/10000/11010/11010/01010",
    },
)
PEPSI = _glyph_box(
    "Pepsi",
    {
        "+z": "01111/10000/01000/01000/11000",
        "-x": "10011/00110/00110/10101/01010",
        "+x": "00101/11010/10100/10100/01110",
    },
)
SHELL = _glyph_box(
    "Shell",
    {
        "+z": "10111/01001/01001/01001/01001",
        "-x": "10111/10000/01001/01110/01110",
        "+y": "01001/10000/10000/01001/10111",
    },
)
NOMINAL_BOXES: tuple[BoxPrototype, ...] = (STELLA_ARTOIS, PEPSI, SHELL)
