"""``ecat box``: a box with markers of your own, for the tracker and the printer."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from ecat.cli.output import Output
from ecat.cli.verb import verb
from ecat.errors import UsageError

if TYPE_CHECKING:
    from ecat.model.prototype import BoxPrototype, FaceName, MarkerFace, Triple

_FACE = re.compile(r"(?P<face>[+-][xyz])=(?P<marker>.+?)(:(?P<side>[0-9.]+))?")
_USUAL_SHARE = 0.7


@verb(
    "box",
    examples=(
        "ecat box boxes.json --name Red --size 0.06 --face +z=0 --face +x=1 --face -y=2 --print red.svg",
        "ecat box boxes.json --name Long --size 0.12,0.06,0.06 --face +z=3:0.045 --face -x=4",
        "ecat box boxes.json --name Shell --size 0.15 --face +z=426.glyph:0.089 --face -x=303.glyph:0.089",
    ),
)
@click.argument(
    "dest", type=click.Path(path_type=Path), help="The JSON file; a box of that name in it is replaced."
)
@click.option("--name", required=True, help="Name of the box.")
@click.option(
    "--size", required=True, metavar="M[,M,M]", help="Its edge, or its edges along x, y, z, metres."
)
@click.option(
    "--face",
    "faces",
    multiple=True,
    required=True,
    metavar="FACE=MARKER[:SIDE]",
    help="A face (+x -x +y -y +z -z), its marker (a number in the dictionary, or a .glyph file), and the length of the "
    "marker's side in metres (70 % of the face's shorter edge if not given); may be repeated.",
)
@click.option(
    "--dictionary", default="DICT_5X5_50", show_default=True, metavar="NAME", help="OpenCV's dictionary."
)
@click.option(
    "--print",
    "sheet",
    type=click.Path(path_type=Path),
    metavar="FILE.svg",
    help="Also write its markers at true scale; more pages than one are numbered.",
)
def command(
    out: Output, dest: Path, name: str, size: str, faces: tuple[str, ...], dictionary: str, sheet: Path | None
) -> None:
    """Describe a box with markers: its size, and which marker is on which face.

    The markers are glued on upright in the middle of each face: on the sides the top of the print is towards +z, on
    +z towards +y, on -z towards -y.  The file is for `ecat process --prototypes`; each call adds a box to it.
    """
    from ecat import process
    from ecat.geometry.markers import codebooks
    from ecat.geometry.sheet import marker_sheets

    edges = _edges(size)
    box = _box(name, edges, [_face(text, edges, dictionary) for text in faces])
    others = [b for b in process.read_prototypes(dest) if b.name != name] if dest.exists() else []
    boxes = [*others, box]
    codebooks(boxes, mirrored=False)
    pages = marker_sheets([box]) if sheet is not None else []
    files = _write_sheets(sheet, pages) if sheet is not None else []
    process.write_prototypes(dest, boxes)
    text = f"{name}: {len(box.faces)} markers; {dest} has {len(boxes)} box{'es' if len(boxes) > 1 else ''}"
    text += "".join(f"\nwrote {file}; print it at 100 %" for file in files)
    out.result({"file": str(dest), "box": box.to_dict(), "n_boxes": len(boxes), "sheets": files}, text)


def _edges(text: str) -> Triple:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 3) or not all(0 < edge <= 10 for edge in numbers):
        raise UsageError(
            "cannot make the box",
            where=f"--size {text}: expected one or three lengths in metres",
            fix="--size 0.06",
        )
    x, y, z = numbers * 3 if len(numbers) == 1 else numbers
    return x, y, z


def _face(text: str, size: Triple, dictionary: str) -> MarkerFace:
    from ecat.formats.ecat2018.glyphs import read_glyph
    from ecat.geometry.markers import code_of, dictionary_code
    from ecat.model.prototype import nominal_face

    found = _FACE.fullmatch(text)
    if found is None:
        raise UsageError("cannot make the box", where=f"--face {text}", fix="--face +z=3:0.045")
    marker = found["marker"]
    code = (
        dictionary_code(dictionary, int(marker)) if marker.isdecimal() else code_of(read_glyph(Path(marker)))
    )
    face = cast("FaceName", found["face"])
    room = min(edge for edge, axis in zip(size, "xyz", strict=True) if axis != face[1])
    side = _side(found["side"], text) if found["side"] else round(_USUAL_SHARE * room, 4)
    if side > room:
        raise UsageError(
            "cannot make the box",
            where=f"--face {text}: a marker of {side:g} m does not fit on a face of {room:g} m",
            fix="make it smaller; it needs some white around it",
        )
    return nominal_face(face, code, side, size)


def _side(text: str, face: str) -> float:
    try:
        side = float(text)
    except ValueError:
        side = 0.0
    if side <= 0:
        raise UsageError(
            "cannot make the box",
            where=f"--face {face}: expected a length in metres after the colon",
            fix=f"write the side of the marker's black square: --face {face}=NUMBER:0.045",
        )
    return side


def _box(name: str, size: Triple, faces: list[MarkerFace]) -> BoxPrototype:
    from ecat.model.prototype import BoxPrototype

    # read back, so that what is wrong is said here and not by whoever uses the file
    return BoxPrototype.from_dict(BoxPrototype(name, size, tuple(faces)).to_dict())


def _write_sheets(path: Path, pages: list[str]) -> list[str]:
    from ecat.store import staged_file, write_new_file

    files = [path.with_stem(f"{path.stem}-{i}") if len(pages) > 1 else path for i in range(1, len(pages) + 1)]
    for file, page in zip(files, pages, strict=True):
        with staged_file(file, replaces=b"<?xml") as staging:
            write_new_file(staging, [page.encode()])
    return [str(file) for file in files]
