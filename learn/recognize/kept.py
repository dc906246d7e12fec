"""What is kept in the folder of a run: arrays and JSON, written whole, and read as what anybody may have made.

Reading executes nothing, and takes no more memory than the limits say.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Container, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ecat.errors import InputError, LimitError, NotFoundError
from ecat.store import staged_file
from learn.recognize.unusable import undamaged

CONFIG = "config.json"
MOST_BYTES = 512 * 2**20
"""Of the arrays of one file: those of a checkpoint of the thesis' LSTM with 1000 units, and far more than a model has
that is trained on hundreds of sessions as usual."""
MOST_CONFIG_BYTES = 4 * 2**20
"""Of a config.json, in which every session that was trained on takes 22."""
HEADS = {".json": b"{", ".npz": b"PK", ".parquet": b"PAR1", ".png": b"\x89PNG"}
"""How files begin that may be replaced, by the suffix of their name."""
_NUMBERS = "biuf"


def read_config(run: Path) -> dict[str, Any]:
    """What config.json says of the model in the folder ``run``; all numbers in it are finite.

    Raises
    ------
    NotFoundError : there is none.
    CorruptError : it is damaged, or longer than :data:`MOST_CONFIG_BYTES`.
    """
    what = f"cannot use the model {run}"
    if not (run / CONFIG).is_file():
        fix = f"ecat learn recognize train DIR --run {run}"
        raise NotFoundError(what, where=f"there is no {CONFIG}", fix=fix)
    with undamaged(what):
        return read_json(run / CONFIG)


def read_json(source: Path) -> dict[str, Any]:
    """The object in a JSON file, all numbers of which are finite.

    To be called in :func:`undamaged`: what is raised where the file is damaged may be anything.

    Raises
    ------
    ValueError, TypeError : it is longer than :data:`MOST_CONFIG_BYTES`, or no such object.
    """
    with source.open("rb") as stream:
        text = stream.read(MOST_CONFIG_BYTES + 1)
    if len(text) > MOST_CONFIG_BYTES:
        raise ValueError(f"{source.name} has more than {MOST_CONFIG_BYTES:,} bytes")
    found: Any = json.loads(text.decode(), parse_float=_finite, parse_constant=_finite)
    if not isinstance(found, dict):
        raise TypeError(f"{source.name} is no object")
    return found


def read_arrays(source: Path, names: Container[str] | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of numbers in a file, by name: as :func:`write_arrays` writes them, and no others.

    Nothing is unpacked before the sizes of all of it are known to be right.  To be called in :func:`undamaged`: what is
    raised where the file is damaged may be anything.

    Parameters
    ----------
    names : that may be in it; any if not given.

    Raises
    ------
    ValueError : it has other arrays, or larger ones than :data:`MOST_BYTES`, or numbers that are NaN.
    """
    with zipfile.ZipFile(source) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        if len(members) != len(archive.infolist()):
            raise ValueError("it has two arrays of one name")
        for name, info in members.items():
            if not info.filename.endswith(".npy") or not (names is None or name in names):
                raise ValueError(f"it has an array {name[:100]}, which is of no use")
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError(f"its array {name} is packed in another way")
        if (size := sum(info.file_size for info in members.values())) > MOST_BYTES:
            raise ValueError(f"its arrays have {size:,} bytes, more than {MOST_BYTES:,}")
        return {name: _array(name, archive.read(info)) for name, info in members.items()}


def write_arrays(dest: Path, arrays: Mapping[str, NDArray[Any]], *, compressed: bool = False) -> None:
    """Write arrays of numbers by name, without pickles; replaces such a file.

    Raises
    ------
    InputError : some are NaN, of which nothing could be recognised.
    LimitError : they are larger than what would be read.
    StoreError : they cannot be written.
    """
    what = f"cannot keep {dest}"
    if unknown := [name for name, values in arrays.items() if np.isnan(values).any()]:
        raise InputError(
            what,
            where=f"{unknown[0]} has numbers that are not known (NaN)",
            consequence="it was not written",
            fix="look for coordinates that are far too large, or train more slowly",
        )
    require_size(dest, sum(values.nbytes for values in arrays.values()))
    write: Any = np.savez_compressed if compressed else np.savez
    with staged_file(dest, replaces=HEADS[".npz"]) as staging, staging.open("wb") as stream:
        write(stream, allow_pickle=False, **arrays)


def require_size(dest: Path, n_bytes: int) -> None:
    """Return if arrays of so many bytes can be kept: what is larger would not be read.

    Raises
    ------
    LimitError : they cannot.
    """
    if n_bytes > MOST_BYTES:
        raise LimitError(
            f"cannot keep {dest}",
            where=f"it has {n_bytes:,} bytes, more than {MOST_BYTES:,}",
            consequence="it was not written",
            fix="train a smaller model",
        )


def write_json(data: Mapping[str, Any], dest: Path) -> None:
    """Write data as JSON; replaces such a file.

    Raises
    ------
    InputError : a number in it is not finite.
    StoreError : it cannot be written.
    """
    try:
        text = json.dumps(data, indent=1, allow_nan=False)
    except ValueError:
        raise InputError(
            f"cannot write {dest}",
            where="a number in it is not finite",
            consequence="it was not written",
            fix="look for coordinates that are far too large, or train more slowly",
        ) from None
    with staged_file(dest, replaces=HEADS[".json"]) as staging:
        staging.write_text(text + "\n", "utf-8")


def require_free(run: Path, names: Iterable[str]) -> None:
    """Return if files of these names can be written into the folder ``run``: say so before the work, not after it.

    Raises
    ------
    StoreError : they cannot, as there is something else, or the folder is none.
    """
    for name in names:
        with suppress(_NotYetError), staged_file(run / name, replaces=HEADS[Path(name).suffix]) as staging:
            staging.touch()
            raise _NotYetError


class _NotYetError(Exception):
    """Leaves everything as it was."""


def _array(name: str, data: bytes) -> NDArray[Any]:
    stream = io.BytesIO(data)
    if npy.read_magic(stream) != (1, 0):
        raise ValueError(f"its array {name} is of another version")
    shape, by_columns, dtype = npy.read_array_header_1_0(stream)
    if dtype.kind not in _NUMBERS:
        raise ValueError(f"its array {name} has anything but numbers")
    if math.prod(shape) * dtype.itemsize != len(data) - stream.tell() or min(shape, default=0) < 0:
        raise ValueError(f"its array {name} has more or fewer numbers than it says")
    found = (
        np.frombuffer(data[stream.tell() :], dtype).reshape(shape, order="F" if by_columns else "C").copy()
    )
    if np.isnan(found).any():
        raise ValueError(f"its array {name} has numbers that are not known (NaN)")
    return found


def _finite(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError(f"{text[:50]} is no number")
    return value
