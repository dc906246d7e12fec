"""Pictures for the things in a scene, made from a random generator: wood, cloth, paper with text, patterns, faces of
marked boxes.  All are (rows, columns, 3) uint8, blue, green, red, unless said otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Literal, TypeAlias, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.geometry.boxes import box_corners
from ecat.geometry.transforms import Floats, matrix_from_quaternion
from ecat.model.prototype import UPRIGHT, BoxPrototype, FaceName, face_normal
from ecat.sample.pixels.layers import Quad

Picture: TypeAlias = NDArray[np.uint8]
Texture: TypeAlias = Literal["wood", "cloth", "clutter", "text", "checker", "photo"]
TEXTURES: tuple[Texture, ...] = get_args(Texture)

FACE_TEXELS = 200
BLACK, WHITE = 24, 214
"""Brightness of a marker's print and of the paper under full light."""
_QUIET_CELLS = 1.3
_WORDS: tuple[str, ...] = (
    *(
        "MODEL",
        "0417",
        "slide",
        "the",
        "next",
        "past",
        "block",
        "1010",
        "01101",
        "serial",
        "TOP",
        "THIS",
        "SIDE",
    ),
    *(
        "UP",
        "fragile",
        "500 g",
        "best before",
        "base",
        "water,",
        "II",
        "III",
        "IV",
        "||||",
        "###",
        "[]",
        "=",
        "code",
    ),
)


def covered(picture: Picture) -> Picture:
    """The picture (rows, columns, 4) with full coverage."""
    return np.dstack([picture, np.full(picture.shape[:2], 255, np.uint8)])


def smooth_noise(rng: np.random.Generator, shape: tuple[int, int], cells: tuple[int, int]) -> Floats:
    """A random field in [-1, 1] that varies over about 1 / ``cells`` of the picture."""
    coarse = rng.uniform(-1, 1, (cells[1] + 1, cells[0] + 1))
    return np.asarray(cv2.resize(coarse, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC), np.float64)


def _tinted(value: Floats, color: tuple[float, float, float]) -> Picture:
    return np.clip(value[..., None] * np.array(color), 0, 255).astype(np.uint8)


def wood(rng: np.random.Generator, shape: tuple[int, int]) -> Picture:
    """Boards with grain along the columns."""
    rows, columns = shape
    y, x = np.mgrid[0:rows, 0:columns] / rows
    bent = y * rng.uniform(25, 40) + 1.5 * smooth_noise(rng, shape, (3, 12)) + 0.3 * x
    grain = 0.5 + 0.5 * np.sin(2 * math.pi * bent)
    fibre = cv2.GaussianBlur(rng.normal(0, 1, shape), (0, 0), sigmaX=14, sigmaY=0.8)
    value = 150 + 14 * grain + 60 * fibre + 8 * smooth_noise(rng, shape, (6, 6))
    boards = np.repeat(rng.uniform(-10, 10, 6), -(-rows // 6))[:rows, None]
    value = value + boards - 35 * (np.abs((y * 6) % 1 - 0.5) > 0.494)
    return _tinted(value / 160, tuple((np.array([78, 112, 150]) * rng.uniform(0.8, 1.15)).tolist()))


def cloth(rng: np.random.Generator, shape: tuple[int, int]) -> Picture:
    """A woven cloth with stripes."""
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    weave = 0.5 * np.sin(x * 2 * math.pi / 5) + 0.5 * np.sin(y * 2 * math.pi / 5)
    period = rng.uniform(60, 160)
    stripe = np.tanh(8 * np.sin(x * 2 * math.pi / period)) + np.tanh(8 * np.sin(y * 2 * math.pi / period))
    value = 0.8 + 0.05 * weave + 0.08 * stripe + 0.05 * smooth_noise(rng, shape, (8, 8))
    return _tinted(value + rng.normal(0, 0.02, shape), tuple(rng.uniform(70, 190, 3).tolist()))


def text(rng: np.random.Generator, shape: tuple[int, int]) -> Picture:
    """A printed page, or many of them."""
    page = np.full((*shape, 3), 225, np.uint8)
    y = 0
    while y < shape[0] + 40:
        scale = float(rng.choice([0.4, 0.5, 0.7, 1.1, 2.4], p=[0.3, 0.3, 0.2, 0.12, 0.08]))
        y += int(34 * scale)
        line = " ".join(rng.choice(_WORDS, 3 + int(shape[1] / (60 * scale))))
        font = int(rng.choice([cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_COMPLEX, cv2.FONT_HERSHEY_PLAIN]))
        start = (int(rng.integers(-40, 40)), y)
        ink = tuple(int(value) for value in rng.integers(10, 90, 3))
        cv2.putText(page, line, start, font, scale, ink, max(1, round(1.6 * scale)), cv2.LINE_AA)
    return page


def checker(rng: np.random.Generator, shape: tuple[int, int]) -> Picture:
    """Squares in black and white: a chessboard of which some are inverted, as in markers that nobody made."""
    cell = int(rng.integers(12, 40))
    rows, columns = -(-shape[0] // cell), -(-shape[1] // cell)
    board = (np.add.outer(np.arange(rows), np.arange(columns)) % 2).astype(bool)
    if rng.random() < 0.5:
        board ^= rng.random(board.shape) < 0.4
    big = np.kron(board, np.ones((cell, cell)))[: shape[0], : shape[1]]
    return _tinted(np.asarray(30 + 190 * big, np.float64), (1.0, 1.0, 1.0))


def photo(rng: np.random.Generator, shape: tuple[int, int]) -> Picture:
    """Edges, blobs and textures of all sizes with the spectrum of photographs (amplitude 1 / frequency)."""
    frequency = np.hypot(*np.meshgrid(np.fft.rfftfreq(shape[1]), np.fft.fftfreq(shape[0])))
    frequency[0, 0] = 1
    planes: list[Floats] = []
    shared = rng.normal(0, 1, shape)
    for _ in range(3):
        spectrum = np.fft.rfft2(0.9 * shared + 0.25 * rng.normal(0, 1, shape)) / frequency
        spectrum[0, 0] = 0
        plane = np.fft.irfft2(spectrum, shape)
        planes.append(128 + 50 * plane / plane.std())
    made = np.clip(np.stack(planes, -1), 0, 255).astype(np.uint8)
    for _ in range(int(rng.integers(5, 30))):
        centre = rng.uniform(0, 1, 2) * [shape[1], shape[0]]
        ring = centre + rng.normal(0, 0.08 * shape[1], (int(rng.integers(3, 7)), 2))
        color = tuple(int(value) for value in rng.integers(0, 256, 3))
        cv2.fillConvexPoly(made, cv2.convexHull(np.rint(ring).astype(np.int32)), color, cv2.LINE_AA)
    return made


def clutter(rng: np.random.Generator, shape: tuple[int, int]) -> Picture:
    """Pages, patterned cards and rectangles lying about on wood."""
    table = wood(rng, shape)
    for _ in range(int(rng.integers(10, 18))):
        card = rng.choice([text, text, checker, cloth])  # pyright: ignore[reportArgumentType, reportCallIssue]
        size = rng.uniform(0.07, 0.22, 2) * shape[0]
        _lay(table, card(rng, (int(size[1]), int(size[0]))), rng)
    return table


def _lay(table: Picture, card: Picture, rng: np.random.Generator) -> None:
    """Put a card anywhere on the table, turned."""
    place = rng.uniform(0, 1, 2) * [table.shape[1], table.shape[0]]
    turn = cv2.getRotationMatrix2D((card.shape[1] / 2, card.shape[0] / 2), rng.uniform(0, 360), 1.0)
    turn[:, 2] += place - [card.shape[1] / 2, card.shape[0] / 2]
    seen = cv2.warpAffine(covered(card), turn, (table.shape[1], table.shape[0]))
    where = seen[..., 3] > 127
    table[where] = seen[where][:, :3]


MAKERS: dict[Texture, Callable[[np.random.Generator, tuple[int, int]], Picture]] = {
    "wood": wood,
    "cloth": cloth,
    "clutter": clutter,
    "text": text,
    "checker": checker,
    "photo": photo,
}


def distractor(seed: int, size: tuple[int, int] = (640, 480)) -> Picture:
    """An image (height, width, 3) without any marker, full of what may be taken for one: another for every seed.

    Pages, patterns and photograph-like noise, in layers, turned and in perspective.
    """
    rng = np.random.default_rng([seed, 81])
    width, height = size
    kinds: list[Texture] = [TEXTURES[k] for k in rng.integers(0, len(TEXTURES), 2)]
    made = MAKERS[kinds[0]](rng, (height, width))
    for kind in kinds[1:]:
        card = covered(MAKERS[kind](rng, (height, width)))
        ring = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
        bent = ring * np.float32(rng.uniform(0.3, 1.1)) + rng.uniform(-0.3, 0.3, (4, 2)) * [width, height]
        bent += rng.uniform(0, 0.5, 2) * [width, height]
        seen = cv2.warpPerspective(card, cv2.getPerspectiveTransform(ring, bent.astype(np.float32)), size)
        share = seen[..., 3:] / np.float32(255)
        made = np.asarray(seen[..., :3] + (1 - share) * made, np.uint8)
    return made


# ------------------------------------------------------------------------------------------------ boxes


def box_faces(box: BoxPrototype, *, markers: bool = True) -> tuple[Quad, ...]:
    """The six faces in box axes, with the markers printed on white paper where the prototype has them."""
    size = np.array(box.size_m)
    marked = {face.face: k for k, face in enumerate(box.faces)} if markers else {}
    quads: list[Quad] = []
    for name, upright in UPRIGHT.items():
        turn = matrix_from_quaternion(np.array(upright))
        centre = np.array(face_normal(name)) * size / 2
        right, down = turn[:, 0] * abs(turn[:, 0] @ size), -turn[:, 1] * abs(turn[:, 1] @ size)
        quad = Quad(centre - (right + down) / 2, right, down, _blank(box.name, name))
        if name in marked:
            k = marked[name]
            ring = box_corners(box)[k] - quad.corner
            flat = np.stack([ring @ right / (right @ right), ring @ down / (down @ down)], -1)
            quad = Quad(quad.corner, right, down, _stuck(quad.texture, flat, box.faces[k].code))
        quads.append(quad)
    return tuple(quads)


@lru_cache(maxsize=64)
def _blank(name: str, face: FaceName) -> Picture:
    """A painted or unpainted wooden face with worn edges; the same for the same box."""
    rng = np.random.default_rng([*name.encode(), *face.encode()])
    shade = np.random.default_rng([*name.encode()]).uniform(0.75, 1.2)
    n = FACE_TEXELS
    fibre = cv2.GaussianBlur(rng.normal(0, 1, (n, n)), (0, 0), sigmaX=20, sigmaY=1.2)
    edge = np.minimum(*np.meshgrid(*[np.minimum(np.arange(n), n - 1 - np.arange(n))] * 2))
    value = 1 + 0.6 * fibre + 0.05 * smooth_noise(rng, (n, n), (4, 4)) - 0.3 * np.exp(-edge / 4)
    return covered(_tinted(value * shade, (92.0, 128.0, 158.0)))


def _stuck(face: Picture, ring: Floats, code: str) -> Picture:
    """A marker's print glued onto a face; ``ring`` (4, 2) are its corners as shares of the face."""
    cells = math.isqrt(len(code))
    print_ = np.zeros((cells + 2, cells + 2))
    print_[1:-1, 1:-1] = np.array(list(code), int).reshape(cells, cells)
    texels, fine = 48, 4
    picture = np.kron(BLACK + (WHITE - BLACK) * print_, np.ones((texels, texels)))
    quiet = round(_QUIET_CELLS * texels)
    paper = np.pad(picture, quiet, constant_values=WHITE).astype(np.uint8)
    paper = np.dstack([paper, paper, paper, np.full(paper.shape, 255, np.uint8)])
    n = FACE_TEXELS * fine
    side = picture.shape[0]
    corners = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32) + quiet - 0.5
    turn = cv2.getPerspectiveTransform(corners, (ring * n - 0.5).astype(np.float32))
    seen = cv2.resize(
        cv2.warpPerspective(paper, turn, (n, n)), (FACE_TEXELS,) * 2, interpolation=cv2.INTER_AREA
    )
    share = seen[..., 3:] / 255
    mixed = seen[..., :3] + (1 - share) * face[..., :3]
    return covered(np.rint(mixed).astype(np.uint8))
