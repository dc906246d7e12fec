"""One line of a layer's journal: who did what, when, and what it changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ecat.model.changes import Change


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """One step of the history of a layer, which is one step of undo.

    Parameters
    ----------
    revision : the layer's after it, counted from 1.
    author, time : who did it, and when (UTC, ISO 8601 with milliseconds).
    operation : as it was asked for: ``{"op": "add_event", ...}``; several at once are a ``batch`` of ``operations``;
        ``undo`` names the revision that it ``undoes``, ``redo`` the one that it ``redoes``, ``restore`` the
        ``revision`` that is the layer's state again, and ``replace`` stands for whatever another program wrote.
    changes : what it did.
    """

    revision: int
    author: str
    time: str
    operation: dict[str, Any]
    changes: tuple[Change, ...] = ()

    @property
    def op(self) -> str:
        """The name of the operation."""
        return str(self.operation.get("op", ""))

    def to_dict(self) -> dict[str, Any]:
        """The record as it stands in the journal, and goes over HTTP."""
        return {
            "revision": self.revision,
            "author": self.author,
            "time": self.time,
            "operation": self.operation,
            "changes": [change.to_dict() for change in self.changes],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Record:
        """The record that :meth:`to_dict` wrote.

        Raises
        ------
        KeyError, TypeError, ValueError : it is none.
        """
        return cls(
            revision=int(data["revision"]),
            author=str(data["author"]),
            time=str(data["time"]),
            operation=dict(data["operation"]),
            changes=tuple(Change.from_dict(change) for change in data["changes"]),
        )
