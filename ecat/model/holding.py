"""Which relations hold when: marked facts turned into intervals (ECAT 2018 file format §2.10).

A positive fact first ends the facts that conflict with it by a constraint, then holds itself, unless one of
its objects is absent (IDENTITY is exempt).  A negative fact ends its exact positive counterpart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from ecat.model.annotation import AnnotatedObject, Relation
from ecat.model.scheme import CodingScheme


def present_at(thing: AnnotatedObject, frame: int) -> bool:
    """Whether the object is there at ``frame``: its last key frame up to then is not an absence.

    An object without key frames (its marks are in a table) counts as present.  Unlike ECAT, an absence at the
    very first frame counts.
    """
    last = None
    for key in thing.key_frames:
        if key.frame <= frame:
            last = key
    return last.present if last is not None else not thing.key_frames


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
    relations: Iterable[Relation],
    scheme: CodingScheme,
    is_present: Callable[[str, int], bool],
) -> Iterator[tuple[int, Relation, int | None]]:
    """Every positive relation with the frame at which it stops holding.

    Yields ``(index, relation, end_frame)`` where ``index`` counts ``relations`` and ``end_frame`` is ``None``
    for facts that hold to the end of the session.  ``is_present(object_id, frame)`` answers for ids of other
    sessions too.
    """
    held: list[tuple[int, Relation]] = []
    ordered = sorted(enumerate(relations), key=lambda pair: pair[1].start_frame)
    for index, relation in ordered:
        if relation.end_frame is not None:
            if relation.polarity:
                yield index, relation, relation.end_frame
            continue
        still: list[tuple[int, Relation]] = []
        for i, old in held:
            same = old.predicate == relation.predicate and old.targets == relation.targets
            ends = same if not relation.polarity else (same or conflicts(scheme, old, relation))
            if ends:
                yield i, old, relation.start_frame
            else:
                still.append((i, old))
        held = still
        exempt = relation.predicate == "IDENTITY"
        if relation.polarity and (
            exempt or all(is_present(t, relation.start_frame) for t in relation.targets)
        ):
            held.append((index, relation))
    for index, relation in held:
        yield index, relation, None
