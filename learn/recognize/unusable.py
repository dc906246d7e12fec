"""Why what is kept of a model cannot be used: whatever is wrong with it, that is one error."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from json import JSONDecodeError
from typing import Any
from zipfile import BadZipFile

import numpy as np

from ecat.errors import CorruptError, EcatError, InputError
from learn.recognize.dataset import SLOTS, Labels, exchanged, places_of
from learn.recognize.grammar import Habits


@contextmanager
def undamaged(
    what: str, *, consequence: str = "nothing was recognised", fix: str = "train it again"
) -> Generator[None]:
    """What fails in the block, which makes something of what a file says, fails because the file is damaged.

    A file may hold anything, and so anything may be raised on the way; errors that say what is wrong are left as they
    are.

    Raises
    ------
    CorruptError : something else was raised; ``what`` could not be done.
    """
    try:
        yield
    except EcatError:
        raise
    except Exception as error:  # noqa: BLE001
        raise CorruptError(what, where=_where(error), consequence=consequence, fix=fix) from None


def _where(error: Exception) -> str:
    """What is wrong, as far as an error of whatever read a file says it."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, BadZipFile):
        return f"its arrays are cut off, or were none: {error}"
    if isinstance(error, (JSONDecodeError, UnicodeDecodeError)):
        return f"its JSON is cut off, or was none: {error}"
    kind = type(error).__name__ if isinstance(error, LookupError) or not str(error) else ""
    return ": ".join(part for part in (kind, str(error)[:200]) if part)


def check_name(name: Any, expected: str, run: Any) -> None:
    """Refuse a model of other features.

    Raises
    ------
    InputError : ``name`` is not what is expected.
    """
    if name != expected:
        raise InputError(
            f"cannot use the model {run}",
            where=f"it was trained with the features {str(name)[:100]}, these are {expected}",
            consequence="nothing was recognised",
            fix="train it again",
        )


def labels_of(config: Mapping[str, Any]) -> Labels:
    """The labels (k, 5) that a model knows: once each, with both names of the boxes.

    Raises
    ------
    ValueError : they are no such labels.
    """
    found = np.array(config["vocabulary"])
    sizes = [len(values) for values in SLOTS.values()]
    if found.dtype.kind != "i" or found.ndim != 2 or found.shape[1] != len(sizes) or not len(found):
        raise ValueError("its vocabulary is no list of labels")
    if not ((found >= 0) & (found < sizes)).all():
        raise ValueError("its vocabulary has labels that there are not")
    labels = found.astype(np.int8)
    if len(np.unique(labels, axis=0)) != len(labels):
        raise ValueError("its vocabulary has a label twice")
    try:
        places_of(exchanged(labels), labels)
    except KeyError:
        raise ValueError("its vocabulary lacks labels with the boxes exchanged") from None
    return labels


def habits_of(config: Mapping[str, Any]) -> Habits:
    """The habits of the sessions that a model was trained on.

    Raises
    ------
    ValueError : they are no shares between 0 and 1.
    TypeError : they are others, or no numbers.
    """
    found = Habits(**{name: float(share) for name, share in config["habits"].items()})
    if not all(0 < share < 1 for share in vars(found).values()):
        raise ValueError("its habits are no shares")
    return found


def prints_of(config: Mapping[str, Any]) -> frozenset[str]:
    """Fingerprints of the sessions that a model was trained on."""
    return frozenset(str(one) for one in config["trained_on"])
