"""Whether a layer that grows can still be written: what is acknowledged has to fit into the XML one day."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic_core import to_json

from ecat.model.changes import Change
from ecat.model.document import Document
from ecat.store.xml import MAX_BYTES, layer_to_xml

_MOST_PER_BYTE = 8
"""A byte of JSON is never more bytes of XML, indentation included."""


class Room:
    """How large the XML of a layer can have become since it was last measured.

    Parameters
    ----------
    size : bytes of the XML.
    """

    def __init__(self, size: int) -> None:
        self._size = size

    def took(self, changes: Iterable[Change]) -> None:
        """Count in changes that are in the journal already."""
        self._size += sum(_most_bytes(change) for change in changes)

    def require(self, changes: Iterable[Change], document: Document) -> None:
        """Return if ``document``, in which the changes are made, can be written.

        Raises
        ------
        LimitError : it is larger than what can be read again.
        """
        self.took(changes)
        if self._size > MAX_BYTES:
            self._size = len(layer_to_xml(document.layer()))


def _most_bytes(change: Change) -> int:
    return 0 if change.after is None else _MOST_PER_BYTE * len(to_json(change.after))
