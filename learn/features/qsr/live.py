"""Relations while they happen: a frame goes in, its values come out, the same as of the whole track."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from learn.features.qsr.codes import MISSING, Codes, Floats
from learn.features.qsr.continuity import between
from learn.features.qsr.relations import Relation


class Live:
    """One relation of any number of pairs.

    Parameters
    ----------
    relation : one of :data:`RELATIONS`.
    parameters : of its function.
    """

    def __init__(self, relation: Relation, **parameters: Any) -> None:
        self.relation = relation
        self._parameters = parameters
        self._before: list[Floats] | None = None

    def feed(self, *objects: ArrayLike) -> Codes:
        """The values (...) of the frame in which the objects are at (..., 2); all missing before there is movement."""
        now = [np.array(each, np.float64) for each in objects]
        if self.relation.frames == 1:
            return self.relation.compute(*now, **self._parameters)
        before, self._before = self._before, now
        if before is None:
            return np.full(np.broadcast_shapes(*(each.shape[:-1] for each in now)), MISSING, np.uint8)
        tracks = [np.stack(pair, axis=-2) for pair in zip(before, now, strict=True)]
        return self.relation.compute(*tracks, **self._parameters)[..., 0]


class LiveChain:
    """The chain of one track's QTC states, as :func:`learn.features.qsr.chain` makes it.

    Parameters
    ----------
    values : the names of the codes: ``QTC_B``, ``QTC_C`` or ``QTC_BC``.
    collapse, validate : what the chain is to be.
    """

    def __init__(self, values: tuple[str, ...], *, collapse: bool = True, validate: bool = True) -> None:
        self._between = between(values)
        self._collapse, self._validate = collapse, validate
        self._last = MISSING

    def feed(self, state: int) -> tuple[int, ...]:
        """What the state adds to the chain: nothing, itself, or one that was passed through and itself."""
        last = self._last
        if state == MISSING or (self._collapse and state == last):
            return ()
        self._last = state
        passed = int(self._between[last, state]) if self._validate and last != MISSING else MISSING
        return (state,) if passed == MISSING else (passed, state)
