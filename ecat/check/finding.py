"""What a check says, and what it looks at."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Literal, TypeAlias

import numpy as np
import pyarrow as pa

from ecat.model import CodingScheme, Layer, Manifest

Severity: TypeAlias = Literal["error", "warning", "note"]
Objects: TypeAlias = frozenset[str] | Literal["unreadable"] | None
"""Ids of the objects of a session; ``unreadable`` if not all of them are known, None if there is no such session."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that is not as it should be.

    Parameters
    ----------
    severity : ``error``: data is lost, contradicts itself or cannot be read; ``warning``: what is computed
        from it may be wrong; ``note``: worth knowing, no action needed.
    code : short name of the kind of finding, stable between versions.
    place : where in the session (``layer main, event a3``; ``table poses, box o2``).
    message : what is wrong, with the figures.
    repair : what ``--repair`` does about it; empty where a person has to decide.
    fix : what to do about it, with the command where there is one.
    session : the session's folder, relative to the path that was checked; ``.`` for that path itself.
    """

    severity: Severity
    code: str
    place: str
    message: str
    repair: str = ""
    fix: str = ""
    session: str = "."

    def to_dict(self) -> dict[str, str]:
        """The finding as JSON-able data."""
        return asdict(self)


def error(code: str, place: str, message: str, repair: str = "") -> Finding:
    """A finding that is an error."""
    return Finding(severity="error", code=code, place=place, message=message, repair=repair)


def warning(code: str, place: str, message: str, repair: str = "") -> Finding:
    """A finding that is a warning."""
    return Finding(severity="warning", code=code, place=place, message=message, repair=repair)


def note(code: str, place: str, message: str, repair: str = "") -> Finding:
    """A finding that is a note."""
    return Finding(severity="note", code=code, place=place, message=message, repair=repair)


@dataclass(frozen=True, kw_only=True)
class Patient:
    """One session as the checks see it: only what could be read, so that no check has to handle broken files.

    Parameters
    ----------
    layers : the readable layers by name.
    table : a table with a sound schema by name, or None.
    scheme : a coding scheme by name, or None.
    sibling : the objects of another session of the same project by its name.
    """

    manifest: Manifest
    layers: Mapping[str, Layer]
    table: Callable[[str], pa.Table | None]
    scheme: Callable[[str], CodingScheme | None]
    sibling: Callable[[str], Objects]

    @property
    def unread_layers(self) -> list[str]:
        """The layers that the session has, and that could not be read."""
        return [record.name for record in self.manifest.layers if record.name not in self.layers]

    @property
    def frame_period_s(self) -> float | None:
        """Typical time from one image to the next, seconds; None without a clock."""
        frames = self.table("frames")
        if frames is not None and frames.num_rows > 1:
            t, image = (frames[name].to_numpy() for name in ("t_ns", "frame"))
            # Python's integers: differences of the largest ones overflow
            span = int(image.max()) - int(image.min())
            return (int(t.max()) - int(t.min())) / 1e9 / span if span else None
        clock = self.manifest.clock
        if clock.rule != "uniform" or not clock.duration_ns or self.manifest.n_frames < 2:
            return None
        return clock.duration_ns / 1e9 / (self.manifest.n_frames - 1)


Check: TypeAlias = Callable[[Patient], Iterator[Finding]]


def some(values: np.ndarray[tuple[int], np.dtype[np.integer]] | list[str], most: int = 3) -> str:
    """The first few of ``values`` for a message: ``12, 40, 41 and 8 more``."""
    shown = ", ".join(str(value) for value in values[:most])
    return shown if len(values) <= most else f"{shown} and {len(values) - most:,} more"
