"""Square markers: which codes there are, and which of them a dark quadrilateral shows.

A small or tilted marker is a few blurred pixels wide, so cells are not cut at a threshold.  What each code would look
like through that blur is compared with what is seen; a code is read only if no other value of any one cell, of the
dark border's too, would explain the image better.  That is a match with zero wrong bits, whatever the blur.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError, UsageError
from ecat.geometry.corners import Outlines, Several, sample
from ecat.geometry.transforms import Floats
from ecat.model.prototype import BoxPrototype

# cells around a cell that its blurred value may depend on
_REACH = 2
_SHIFTS = np.array([(i, j) for i in range(-_REACH, _REACH + 1) for j in range(-_REACH, _REACH + 1)], float)
# cells are counted in rows and columns, pixels in x and y
_SQUARES = np.stack([_SHIFTS[:, 1] ** 2, _SHIFTS[:, 0] ** 2, _SHIFTS[:, 0] * _SHIFTS[:, 1]])
# four samples of a cell, in cells from its centre
_WITHIN = 0.2 * np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
# variance in cells^2 of a cell's own width and of its four samples
_CELL_VARIANCE = 1 / 12 + 0.2**2


def cells_of(code: str) -> NDArray[np.uint8]:
    """A code's cells (n, n), 1 = white, rows from the top of the print."""
    n = math.isqrt(len(code))
    return np.array([int(c) for c in code], np.uint8).reshape(n, n)


def code_of(cells: NDArray[np.uint8]) -> str:
    """The cells (n, n) as a code."""
    return "".join(str(int(c)) for c in cells.ravel())


def dictionary_code(dictionary: str, number: int) -> str:
    """The printed code of a marker of one of OpenCV's dictionaries, for instance ``DICT_4X4_50``.

    Raises
    ------
    UsageError : there is no such dictionary, or no such number in it.
    """
    import cv2

    names = sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))
    if dictionary not in names:
        raise UsageError(
            f"no dictionary {dictionary!r}", where=f"there are {', '.join(names)}", fix="name one of them"
        )
    known = cv2.aruco.getPredefinedDictionary(int(getattr(cv2.aruco, dictionary)))
    if not 0 <= number < len(known.bytesList):
        raise UsageError(
            f"no marker {number} in {dictionary}",
            where=f"it has 0 to {len(known.bytesList) - 1}",
            fix="take one of them",
        )
    image = known.generateImageMarker(number, known.markerSize + 2, borderBits=1)
    return code_of((np.asarray(image)[1:-1, 1:-1] > 0).astype(np.uint8))


@dataclass(frozen=True)
class Glyph:
    """A marker as an image shows it: face and box by their index, and by how many corners it is turned.

    The ring's corner ``turn`` comes first in the upright glyph; ``cells`` (n, n) begin at the ring's first corner.
    """

    box: int
    face: int
    turn: int
    cells: NDArray[np.uint8]


@dataclass(frozen=True)
class Codebook:
    """All codes that can be seen, of one size in cells, each in four turns.

    ``plain`` (m, n + 2, n + 2): the glyphs with their dark border, 1 = white.  ``shaded`` (25, m, (n + 2)^2): the same
    on a white ground, shifted in each of 25 ways, so that any blur of them is one sum; without what even or slanting
    light could explain.
    """

    n: int
    glyphs: tuple[Glyph, ...]
    plain: Floats
    shaded: Floats


def codebooks(prototypes: Sequence[BoxPrototype], *, mirrored: bool) -> tuple[Codebook, ...]:
    """The codes of the prototypes' faces as a camera shows them, by size.

    Raises
    ------
    InputError : two faces look alike, or one looks the same when turned.
    """
    glyphs: dict[int, list[Glyph]] = {}
    seen: dict[str, str] = {}
    for b, box in enumerate(prototypes):
        for f, face in enumerate(box.faces):
            cells = cells_of(face.code)
            turns = [np.rot90(np.fliplr(cells) if mirrored else cells, k) for k in range(4)]
            name = f"{box.name} {face.face}"
            for code in {code_of(t) for t in turns}:
                _distinct(code, name, seen)
            if len({code_of(t) for t in turns}) < 4:
                raise _alike(f"{name} looks the same when it is turned")
            glyphs.setdefault(len(cells), []).extend(Glyph(b, f, -k % 4, t) for k, t in enumerate(turns))
    return tuple(_codebook(n, found) for n, found in sorted(glyphs.items()))


def _distinct(code: str, name: str, seen: dict[str, str]) -> None:
    if seen.setdefault(code, name) != name:
        raise _alike(f"{seen[code]} and {name} carry the same marker")


def _alike(where: str) -> InputError:
    return InputError(
        "cannot tell the markers apart",
        where=where,
        consequence="no marker was looked for",
        fix="use boxes whose faces all carry different markers",
    )


def _codebook(n: int, glyphs: Sequence[Glyph]) -> Codebook:
    plain = np.pad(np.stack([g.cells for g in glyphs]).astype(float), ((0, 0), (1, 1), (1, 1)))
    ground = ((0, 0), (_REACH, _REACH), (_REACH, _REACH))
    blurs = _windows(np.pad(plain, ground, constant_values=1.0)).reshape(len(_SHIFTS), len(glyphs), -1)
    light = _ground(n + 2)
    return Codebook(n, tuple(glyphs), plain, blurs - (blurs @ light) @ light.T)


def _windows(wide: Floats) -> Floats:
    """Of images (m, k + 4, k + 4), the (25, m, k, k) that begin at every shift of _SHIFTS."""
    k = wide.shape[1] - 2 * _REACH
    return np.stack([wide[:, i : i + k, j : j + k] for i, j in (_SHIFTS + _REACH).astype(int).tolist()])


@dataclass(frozen=True)
class Reading:
    """What n rings show, row by row.

    ``glyph`` (n,) index in the codebook, of the glyph that explains the image best; ``likeness`` (n,) its correlation
    with the image; ``contrast`` (n,) grey levels between white and black; ``certain`` (n,) no cell would be better
    explained by the other value.
    """

    glyph: NDArray[np.intp]
    likeness: Floats
    contrast: Floats
    certain: NDArray[np.bool_]


def read_codes(
    grey: NDArray[np.uint8] | Several,
    seen: Outlines,
    book: Codebook,
    glyph: NDArray[np.intp] | None = None,
) -> Reading:
    """Compare what is inside of outlines (n), clockwise on the screen, with every glyph of the codebook.

    Where it is known what they should show, ``glyph`` (n,), they are compared with that alone.
    """
    k = book.n + 2
    matrix = homographies(seen.rings)
    kernel = _kernels(matrix, seen.blur_px, k)
    values = _cell_values(grey, matrix, k)
    values = values - (values @ _ground(k)) @ _ground(k).T
    if glyph is None:
        expected = (kernel @ book.shaded.reshape(len(_SHIFTS), -1)).reshape(len(kernel), -1, k * k)
    else:
        expected = kernel[:, None] @ np.moveaxis(book.shaded[:, glyph], 0, 1)
    power = np.maximum(np.einsum("nmc,nmc->nm", expected, expected), 1e-9)
    product = (expected @ values[..., None])[..., 0]
    squares = np.maximum(np.einsum("nc,nc->n", values, values), 1e-9)
    likeness = product / np.sqrt(power * squares[:, None])
    best, rows = np.argmax(likeness, 1), np.arange(len(likeness))
    contrast = product[rows, best] / power[rows, best]
    left = values - contrast[:, None] * expected[rows, best]
    shown = best if glyph is None else glyph
    certain = _no_better_cell(left.reshape(-1, k, k), kernel, book.plain[shown], contrast)
    return Reading(shown, likeness[rows, best], contrast, certain & (contrast > 0))


def homographies(rings: Floats) -> Floats:
    """Homographies (n, 3, 3) that take the unit square (0, 0), (1, 0), (1, 1), (0, 1) to rings (n, 4, 2).

    Heckbert, Fundamentals of Texture Mapping and Image Warping (1989), §2.2.3.
    """
    p = np.asarray(rings, np.float64)
    d1, d2 = p[:, 1] - p[:, 2], p[:, 3] - p[:, 2]
    s = p[:, 0] - p[:, 1] + p[:, 2] - p[:, 3]
    det = d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1]
    det = np.where(np.abs(det) < 1e-9, 1e-9, det)
    g = (s[:, 0] * d2[:, 1] - d2[:, 0] * s[:, 1]) / det
    h = (d1[:, 0] * s[:, 1] - s[:, 0] * d1[:, 1]) / det
    first = p[:, 1] - p[:, 0] + g[:, None] * p[:, 1]
    second = p[:, 3] - p[:, 0] + h[:, None] * p[:, 3]
    top = np.stack([first, second, p[:, 0]], -1)
    return np.concatenate([top, np.stack([g, h, np.ones_like(g)], -1)[:, None]], 1)


def _cell_values(grey: NDArray[np.uint8] | Several, matrix: Floats, k: int) -> Floats:
    """Mean grey value of every cell (n, k * k), row by row from each ring's first corner."""
    points = matrix @ _cell_points(k)
    pixels = (points[:, :2] / np.maximum(points[:, 2:], 1e-6)).astype(np.float32)
    values = sample(grey, pixels[:, 0].copy(), pixels[:, 1].copy()).reshape(len(matrix), k * k, 4)
    return values.sum(-1, dtype=np.float64) / 4


@cache
def _cell_points(k: int) -> Floats:
    """The four places (3, k * k * 4), homogeneous, at which every cell of the unit square is sampled."""
    row, column = np.divmod(np.arange(k * k), k)
    centre = np.stack([column, row], -1) + 0.5
    flat = ((centre[:, None] + _WITHIN) / k).reshape(-1, 2)
    return np.concatenate([flat.T, np.ones((1, len(flat)))])


def _kernels(matrix: Floats, blur_px: Floats, k: int) -> Floats:
    """Weights (n, 25) of the neighbours in a cell's blurred value, from the image's blur at each ring's centre."""
    # the derivative of pixels by cells at the centre, where the homography's denominator is w
    w = (0.5 * (matrix[:, 2, 0] + matrix[:, 2, 1]) + matrix[:, 2, 2])[:, None]
    middle = (0.5 * (matrix[:, :2, 0] + matrix[:, :2, 1]) + matrix[:, :2, 2]) / w
    jx = (matrix[:, :2, 0] - middle * matrix[:, 2:, 0]) / (w * k)
    jy = (matrix[:, :2, 1] - middle * matrix[:, 2:, 1]) / (w * k)
    det = jx[:, 0] * jy[:, 1] - jx[:, 1] * jy[:, 0]
    scale = blur_px**2 / np.maximum(det**2, 1e-9)
    xx = scale * (jy**2).sum(1) + _CELL_VARIANCE
    yy = scale * (jx**2).sum(1) + _CELL_VARIANCE
    xy = -scale * (jx * jy).sum(1)
    form = np.stack([yy, xx, -2 * xy], -1) / (-2 * (xx * yy - xy**2))[:, None]
    weight = np.exp(form @ _SQUARES)
    return weight / weight.sum(1, keepdims=True)


@cache
def _ground(k: int) -> Floats:
    """Orthonormal (k * k, 3): even light, and light that grows along rows or columns."""
    row, column = np.divmod(np.arange(k * k), k)
    basis = np.stack([np.ones(k * k), column - (k - 1) / 2, row - (k - 1) / 2], -1)
    return np.asarray(basis / np.linalg.norm(basis, axis=0), np.float64)


@cache
def _inside(k: int) -> Floats:
    """Whether a cell's neighbour (25, k * k) at each shift is one that is looked at."""
    wide = np.pad(np.ones((1, k, k)), ((0, 0), (_REACH, _REACH), (_REACH, _REACH)))
    return _windows(wide).reshape(len(_SHIFTS), -1)


def _no_better_cell(left: Floats, kernel: Floats, white: Floats, contrast: Floats) -> NDArray[np.bool_]:
    """Whether no change of a single cell would bring what is left over (n, k, k) down."""
    n, k, _ = left.shape
    wide = np.zeros((n, k + 2 * _REACH, k + 2 * _REACH))
    wide[:, _REACH:-_REACH, _REACH:-_REACH] = left
    around = np.lib.stride_tricks.sliding_window_view(wide, (2 * _REACH + 1, 2 * _REACH + 1), (1, 2))
    pull = (around.reshape(n, k * k, -1) @ kernel[..., None])[..., 0]
    change = (1 - 2 * white.reshape(n, -1)) * contrast[:, None]
    # at the rim part of what a cell does is outside of what is looked at
    effect = (kernel**2 @ _inside(k)) * contrast[:, None] ** 2
    return np.asarray((pull * change <= 0.5 * effect).all(1), np.bool_)
