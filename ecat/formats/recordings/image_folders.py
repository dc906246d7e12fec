"""Folders of colour or depth images: which there are, in which order, and of which size."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ecat.errors import EcatError, LimitError
from ecat.formats.recordings.image_files import is_image, read_header

COLOR_FOLDERS = frozenset({"color", "colour", "rgb", "image", "images"})
DEPTH_FOLDERS = frozenset({"depth", "depths"})
MAX_IMAGES = 1_000_000
_DIGITS = re.compile(r"\d+")
_LEAST_PX = 2
Px = tuple[int, int]
"""Width and height."""


def role_folders(path: Path) -> tuple[Path | None, Path | None]:
    """The folders within one that are named for colour and for depth, and have images in them."""
    inner = sorted(child for child in path.iterdir() if child.is_dir())

    def called(words: frozenset[str]) -> Path | None:
        of_name = (child for child in inner if child.name.lower() in words)
        return next((child for child in of_name if any(map(is_image, child.iterdir()))), None)

    return called(COLOR_FOLDERS), called(DEPTH_FOLDERS)


def listed(folder: Path, what: str) -> list[Path]:
    """The images in a folder, by the numbers in their names.

    Raises
    ------
    LimitError : more than :data:`MAX_IMAGES`.
    """
    found: list[Path] = []
    for path in folder.iterdir():
        if is_image(path) and path.is_file():
            found.append(path)
        if len(found) > MAX_IMAGES:
            raise LimitError(
                what, where=f"{folder}: more than {MAX_IMAGES:,} images", fix="make a video of them"
            )
    return sorted(found, key=lambda path: (*natural(path.stem), path.name))


def natural(text: str) -> tuple[str, tuple[int, ...]]:
    """For sorting: what is the same in all names of a sequence, then the numbers."""
    return _DIGITS.sub("#", text), tuple(int(number) for number in _DIGITS.findall(text))


def usable_sizes(paths: Sequence[Path], what: str, notes: list[str], *, deep: bool) -> dict[Path, Px]:
    """Width and height of those that are images, for depth of 16 bits."""
    found: dict[Path, Px] = {}
    bad: list[str] = []
    for path in paths:
        try:
            header = read_header(path, what)
        except LimitError:
            raise
        except EcatError as error:
            bad.append(error.where)
            continue
        if min(header.width_px, header.height_px) < _LEAST_PX:
            bad.append(f"{path.name}: less than {_LEAST_PX} pixels wide or high")
        elif deep and not header.is_deep:
            bad.append(f"{path.name}: depth wants one channel of 16 bits; save it as 16-bit PNG")
        else:
            found[path] = header.width_px, header.height_px
    if bad:
        notes.append(f"{len(bad)} of {len(paths)} images cannot be used and are missing: {bad[0]}")
    return found
