"""Why a model that is kept in a run's folder cannot be used."""

from __future__ import annotations

from typing import Any

from ecat.errors import CorruptError, InputError


def check_name(name: Any, expected: str, run: Any) -> None:
    """Refuse a model of other features.

    Raises
    ------
    InputError : ``name`` is not what is expected.
    """
    if name != expected:
        raise InputError(
            f"cannot use the model {run}",
            where=f"it was trained with the features {name}, these are {expected}",
            consequence="nothing was recognised",
            fix="train it again",
        )


def damaged(run: Any, error: Exception) -> CorruptError:
    """What is raised where reading a model failed by ``error``."""
    return CorruptError(
        f"cannot use the model {run}",
        where=str(error)[:200] or type(error).__name__,
        consequence="nothing was recognised",
        fix="train it again",
    )
