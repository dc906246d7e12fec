"""How ECAT 2018 writes numbers, codes, colours and names (ECAT 2018 file format §1.2.1-1.2.4).

The session keeps values, not text.  A text that its value would not be written as again (a hand-edited file)
is *unusual* and is kept beside the value, so that export is exact.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

# A number as "%.7g" prints it (upper-case exponent of two digits), or an infinity; `-0` is not among them.
_DECIMAL = "|".join(rf"[1-9]\d{{{i}}}\.\d{{0,{5 - i}}}[1-9]" for i in range(6))
NUMBER = (
    rf"(?:0|-?(?:∞|[1-9]\d{{0,6}}|{_DECIMAL}|0\.0{{0,3}}[1-9](?:\d{{0,5}}[1-9])?"
    rf"|[1-9](?:\.\d{{0,5}}[1-9])?E(?:-0[5-9]|-[1-9]\d|\+0[7-9]|\+[1-9]\d)))"
)
USUAL_NUMBERS = rf"^{NUMBER}(?:,{NUMBER})*$"
"""A comma-separated list of numbers in their usual form (RE2 and Python syntax)."""
USUAL_LINES = rf"^{NUMBER}(?:[,\n]{NUMBER})*$"
"""Many such lists, a line each (RE2 syntax)."""


def format_numbers(values: Iterable[float]) -> str:
    """Comma-separated numbers in ECAT's form; NaN (missing) becomes ``-∞``, as a live Kinect wrote it."""
    # `+ 0.0` makes 0 of -0, which ECAT never writes; `%` takes half the time of format()
    text = ",".join(["%.7g" % (value + 0.0) for value in values])
    if "e" in text or "n" in text:
        text = text.replace("e", "E").replace("nan", "-∞").replace("inf", "∞")
    return text


def format_code(code: str) -> str:
    """``1 ,0 ,...``: every cell is followed by a blank, the last too."""
    return " ,".join(code) + " "


def parse_code(text: str) -> str | None:
    """The cells as a string of 0 and 1, or ``None`` if the text holds anything else."""
    code = text.replace(" ", "").replace(",", "")
    cells = text.split(",")
    if len(cells) != len(code) or not all(cell.strip() in ("0", "1") for cell in cells):
        return None
    return code


def color_from_argb(text: str) -> str | None:
    """``#rrggbbaa`` of a signed 32-bit ARGB number; ``None`` if it is none."""
    try:
        number = int(text)
    except ValueError:
        return None
    if not -(1 << 31) <= number < 1 << 31:
        return None
    argb = number & 0xFFFFFFFF
    return f"#{argb & 0xFFFFFF:06x}{argb >> 24:02x}"


def argb_from_color(color: str) -> str:
    """The signed 32-bit ARGB number of ``#rrggbbaa`` (or ``#rrggbb``, opaque)."""
    digits = color.lstrip("#")
    argb = int((digits[6:8] or "ff") + digits[:6], 16)
    return str(argb - (1 << 32) if argb >= 1 << 31 else argb)


_ATTRIBUTE = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\r": "&#xD;", "\n": "&#xA;", "\t": "&#x9;"}
)
_TEXT = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", "\r": "&#xD;"})


def attribute(name: str, value: str) -> str:
    """`` name="value"`` with ECAT's escapes."""
    return f' {name}="{value.translate(_ATTRIBUTE)}"'


def text(value: str) -> str:
    """Element text with ECAT's escapes; line feeds stay raw."""
    return value.translate(_TEXT)


def missing_corners(values: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which points are missing, and which rows say so in another way than ``-∞,-∞,-∞``.

    Missing points are ``-∞`` three times (mapped by a live Kinect), ``-1`` (mapped offline) or ``0`` three
    times (outside the image), and any point with a number that is not finite.

    Parameters
    ----------
    values : (n, points, 3) metres, as read.

    Returns
    -------
    missing : bool (n, points)
    unusual : bool (n,)
    """
    x, y, z = (values[..., i] for i in range(3))
    missing = ~(np.isfinite(x) & np.isfinite(y) & np.isfinite(z))
    same = (x == y) & (y == z)
    missing |= same & ((x == -1) | (x == 0))
    return missing, (missing & ~(same & (x == -np.inf))).any(axis=1)
