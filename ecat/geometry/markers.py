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
    explained by the other value; ``look`` (n, cells) the grey values of the cells, the border's too, without what light
    explains and in units of the contrast.
    """

    glyph: NDArray[np.intp]
    likeness: Floats
    contrast: Floats
    certain: NDArray[np.bool_]
    look: Floats


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
    square = homographies(seen.rings)
    kernel = _kernels(square, seen.blur_px, k)
    values = _without_light(_cell_values(grey, square, k), k)
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
    look = values / np.maximum(contrast, 1e-9)[:, None]
    return Reading(shown, likeness[rows, best], contrast, certain & (contrast > 0), look)


def cell_values(grey: NDArray[np.uint8] | Several, rings: Floats, book: Codebook) -> Floats:
    """Mean grey values of all cells (n, (book.n + 2)^2), without what even or slanting light could explain."""
    k = book.n + 2
    return _without_light(_cell_values(grey, homographies(rings), k), k)


@dataclass(frozen=True)
class Homographies:
    """Homographies (n,) of the unit square: u, v lie at (right u + down v + start) / (g u + h v + 1).

    Pixels are complex numbers, x + iy.
    """

    right: NDArray[np.complex128]
    down: NDArray[np.complex128]
    start: NDArray[np.complex128]
    g: Floats
    h: Floats

    def pixels(self, places: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Where places u, v, 1 (..., 3, k) of the square are in the image (..., n, k)."""
        above = np.stack([self.right, self.down, self.start], 1).astype(np.complex64)
        below = np.stack([self.g, self.h, np.ones_like(self.g)], 1).astype(np.float32)
        points = above @ places
        points *= 1 / np.maximum(below @ places.real, np.float32(1e-6))
        return points


def homographies(rings: Floats) -> Homographies:
    """Those that take (0, 0), (1, 0), (1, 1), (0, 1) to the corners of rings (n, 4, 2).

    Heckbert, Fundamentals of Texture Mapping and Image Warping (1989), §2.2.3.
    """
    p0, p1, p2, p3 = np.ascontiguousarray(rings, np.float64).view(np.complex128)[..., 0].T
    d1, d2, s = (p1 - p2).conj(), p3 - p2, p0 - p1 + p2 - p3
    det = (d1 * d2).imag
    det = np.where(np.abs(det) < 1e-9, 1e-9, det)
    g, h = (s.conj() * d2).imag / det, (d1 * s).imag / det
    return Homographies(p1 - p0 + g * p1, p3 - p0 + h * p3, p0, g, h)


def _cell_values(grey: NDArray[np.uint8] | Several, square: Homographies, k: int) -> Floats:
    """Mean grey value of every cell (n, k * k), row by row from each ring's first corner."""
    points = square.pixels(_cell_points(k))
    each = len(points)
    values = sample(grey, points.view(np.float32).reshape(each, -1, 2))
    return values.sum(0, dtype=np.uint16).reshape(-1, k * k) / each


@cache
def _cell_points(k: int) -> NDArray[np.complex64]:
    """u, v, 1 (4, 3, k * k) of the four places at which every cell of the unit square is sampled.

    They are on top of each other, so that a cell's mean is one sum.
    """
    row, column = np.divmod(np.arange(k * k), k)
    u, v = (((np.stack([column, row], -1) + 0.5 + _WITHIN[:, None]) / k)[..., i] for i in (0, 1))
    return np.stack([u, v, np.ones_like(u)], 1).astype(np.complex64)


def _kernels(square: Homographies, blur_px: Floats, k: int) -> Floats:
    """Weights (n, 25) of the neighbours in a cell's blurred value, from the image's blur at each ring's centre."""
    # the derivative of pixels by cells at the centre, where the homography's denominator is w
    w = 0.5 * (square.g + square.h) + 1
    middle = (0.5 * (square.right + square.down) + square.start) / w
    w *= k
    jx, jy = (square.right - middle * square.g) / w, (square.down - middle * square.h) / w
    product = jx.conj() * jy
    scale = blur_px**2 / np.maximum(product.imag**2, 1e-9)
    xx, yy = scale * np.abs(jy) ** 2 + _CELL_VARIANCE, scale * np.abs(jx) ** 2 + _CELL_VARIANCE
    xy = -scale * product.real
    form = np.stack([yy, xx, -2 * xy], -1) / (-2 * (xx * yy - xy**2))[:, None]
    weight = np.exp(form @ _SQUARES)
    return weight / weight.sum(1, keepdims=True)


@cache
def _ground(k: int) -> Floats:
    """Orthonormal (k * k, 3): even light, and light that grows along rows or columns."""
    row, column = np.divmod(np.arange(k * k), k)
    basis = np.stack([np.ones(k * k), column - (k - 1) / 2, row - (k - 1) / 2], -1)
    return np.asarray(basis / np.linalg.norm(basis, axis=0), np.float64)


def _without_light(values: Floats, k: int) -> Floats:
    return values - (values @ _ground(k)) @ _ground(k).T


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
