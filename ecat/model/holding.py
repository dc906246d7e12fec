"""Which relations hold when: marked facts turned into intervals (ECAT 2018 file format §2.10).

A positive fact ends the facts that conflict with it by a constraint; a negative fact ends its exact positive
counterpart.  A fact holds while all its objects are there; IDENTITY holds of absent ones too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from ecat.model.annotation import AnnotatedObject, Relation
from ecat.model.scheme import CodingScheme

Stretches: TypeAlias = tuple[tuple[int, int | None], ...]
"""Half-open intervals of frames in ascending order, apart from each other; ``None``: to the end."""

ALWAYS: Stretches = ((-1, None),)
"""From the position before the first image on."""


def presence(thing: AnnotatedObject) -> Stretches:
    """When the object is there: from a key frame that is no absence to the next that is one.

    An object without key frames (its marks are in a table) is always there.  Unlike ECAT, an absence at the
    very first frame counts.
    """
    if not thing.key_frames:
        return ALWAYS
    found: list[tuple[int, int | None]] = []
    start: int | None = None
    for frame, present in sorted({key.frame: key.present for key in thing.key_frames}.items()):
        if present and start is None:
            start = frame
        elif not present and start is not None:
            found.append((start, frame))
            start = None
    return (*found, (start, None)) if start is not None else tuple(found)


def conflicts(scheme: CodingScheme, first: Relation, second: Relation) -> bool:
    """Whether two positive relations cannot hold together."""
    for constraint in scheme.constraints:
        names = constraint.names
        if constraint.kind == "UNIQUE":
            k = constraint.unique_argument - 1
            if first.predicate == second.predicate == names[0] and len(first.targets) == len(second.targets):
                same = [a == b for a, b in zip(first.targets, second.targets, strict=True)]
                if 0 <= k < len(same) and not same[k] and all(s for i, s in enumerate(same) if i != k):
                    return True
        elif (
            first.predicate in names
            and second.predicate in names
            and first.predicate != second.predicate
            and len(first.targets) == len(second.targets) == 1
            and first.targets == second.targets
        ):
            return True
    return False


def intervals(
    relations: Sequence[Relation], scheme: CodingScheme, present: Callable[[str], Stretches]
) -> dict[int, Stretches]:
    """When each positive relation holds, by its position in ``relations``; empty if never.

    Relations with an ``end_frame`` hold as they say.  ``present(object_id)`` tells when an object is there, and
    answers for ids of other sessions too.
    """
    found: dict[int, Stretches] = {}
    for index, end in _ends(relations, scheme).items():
        relation = relations[index]
        stretches: Stretches = ((relation.start_frame, end),)
        if relation.end_frame is None and relation.predicate != "IDENTITY":
            for target in relation.targets:
                stretches = _common(stretches, present(target))
        found[index] = stretches
    return found


def _ends(relations: Sequence[Relation], scheme: CodingScheme) -> dict[int, int | None]:
    """The frame at which each positive relation ends or is contradicted."""
    ends: dict[int, int | None] = {}
    held: list[int] = []
    for index, relation in sorted(enumerate(relations), key=lambda pair: pair[1].start_frame):
        if relation.end_frame is None:
            for i in list(held):
                old = relations[i]
                same = old.predicate == relation.predicate and old.targets == relation.targets
                if same or (relation.polarity and conflicts(scheme, old, relation)):
                    ends[i] = relation.start_frame
                    held.remove(i)
        if relation.polarity:
            ends[index] = relation.end_frame
            if relation.end_frame is None:
                held.append(index)
    return ends


def _common(first: Stretches, second: Stretches) -> Stretches:
    """Where both hold."""
    found: list[tuple[int, int | None]] = []
    for a, b in first:
        for c, d in second:
            end = min((e for e in (b, d) if e is not None), default=None)
            if end is None or max(a, c) < end:
                found.append((max(a, c), end))
    return tuple(found)
