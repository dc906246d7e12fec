"""Networks and the state of their training on a disk: arrays, and text; reading them executes nothing."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ecat.errors import InputError
from learn.recognize.kept import read_arrays, write_arrays
from learn.recognize.unusable import undamaged

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
    with going_on(source):
        arrays, text = read_tensors(source)
        kept, history = json.loads(text)
        found = Checkpoint(arrays, dict(history))
    if kept != identity:
        raise InputError(
            f"cannot go on with {source}",
            where="it is of a training with other settings, or on other sessions",
            consequence="nothing was trained",
            fix="name another folder, or remove the checkpoint",
        )
    return found


def going_on(source: Path) -> AbstractContextManager[None]:
    """What fails in the block, which goes on with a checkpoint, fails because that is damaged."""
    what, fix = f"cannot go on with {source}", "remove it, and train again"
    return undamaged(what, consequence="nothing was trained", fix=fix)


def write_tensors(dest: Path, tensors: Mapping[str, Tensor], text: str = "") -> None:
    """Write tensors by name, and a text, as arrays of NumPy without pickles; replaces such a file.

    Raises
    ------
    InputError : a number is not known (NaN): training went astray.
    StoreError : they cannot be written.
    """
    arrays = {name: value.detach().cpu().numpy() for name, value in tensors.items()}
    write_arrays(dest, arrays | {_TEXT: np.frombuffer(text.encode(), np.uint8)})


def read_tensors(source: Path, names: Iterable[str] | None = None) -> tuple[dict[str, Tensor], str]:
    """The tensors and the text of a file; to be called in ``undamaged``, as whatever it reads them with.

    Parameters
    ----------
    names : of the tensors that may be in it.
    """
    arrays = read_arrays(source, None if names is None else {_TEXT, *names})
    text = arrays.pop(_TEXT).tobytes().decode()
    return {name: torch.from_numpy(value) for name, value in arrays.items()}, text
