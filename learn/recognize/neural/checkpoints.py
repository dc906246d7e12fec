"""Networks and the state of their training on a disk: arrays, and text; reading them executes nothing."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ecat.errors import CorruptError, InputError
from ecat.store import staged_file

_ZIP = b"PK"
_TEXT = "text"


@dataclass(frozen=True)
class Checkpoint:
    """Training as it was after an epoch: tensors by name, and what happened until then."""

    arrays: dict[str, Tensor]
    history: dict[str, Any]


def write_checkpoint(dest: Path, checkpoint: Checkpoint, identity: str) -> None:
    """Write a checkpoint in the place of an older one: it is there as a whole, or the older one is."""
    write_tensors(dest, checkpoint.arrays, json.dumps([identity, checkpoint.history]))


def read_checkpoint(source: Path, identity: str) -> Checkpoint:
    """The checkpoint of a training with this identity.

    Raises
    ------
    InputError : it is of a training with other settings, or on other sessions.
    CorruptError : it is damaged.
    """
    arrays, text = read_tensors(source)
    try:
        kept, history = json.loads(text)
        found = Checkpoint(arrays, dict(history))
    except (ValueError, TypeError) as error:
        raise _damaged(source, error) from None
    if kept != identity:
        raise InputError(
            f"cannot go on with {source}",
            where="it is of a training with other settings, or on other sessions",
            consequence="nothing was trained",
            fix="name another folder, or remove the checkpoint",
        )
    return found


def write_tensors(dest: Path, tensors: Mapping[str, Tensor], text: str = "") -> None:
    """Write tensors by name, and a text, as arrays of NumPy without pickles; replaces such a file."""
    arrays: dict[str, Any] = {name: value.detach().cpu().numpy() for name, value in tensors.items()}
    arrays[_TEXT] = np.frombuffer(text.encode(), np.uint8)
    with staged_file(dest, replaces=_ZIP) as staging, staging.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **arrays)


def read_tensors(source: Path) -> tuple[dict[str, Tensor], str]:
    """The tensors and the text of a file.

    Raises
    ------
    CorruptError : it is damaged, or holds anything but numbers.
    """
    try:
        with source.open("rb") as stream, np.load(stream, allow_pickle=False) as kept:
            arrays = {name: np.asarray(kept[name]) for name in kept.files}
        text = arrays.pop(_TEXT).tobytes().decode()
        return {name: torch.from_numpy(value.copy()) for name, value in arrays.items()}, text
    except (ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, EOFError, OSError) as error:
        raise _damaged(source, error) from None


def _damaged(source: Path, error: Exception) -> CorruptError:
    return CorruptError(
        f"cannot read {source}",
        where=str(error)[:200] or type(error).__name__,
        consequence="nothing was taken from it",
        fix="remove it, and train again",
    )
