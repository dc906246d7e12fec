"""Shapes image by image, as other programs keep them, and the key frames that say the same."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TypeAlias

from ecat.model import AnnotatedObject, KeyFrame

UNLABELLED = "unlabelled"
"""The label of what has neither type nor name, where a label is wanted."""
TYPED = "typed"
"""Said of an object whose type is its name, which the label alone would not tell."""
Numbers: TypeAlias = tuple[float, ...]
Slopes: TypeAlias = tuple[float, float]
_STRAIGHT_PX = 1e-5
"""A shape that is off the straight way by no more than this was moved in a straight line."""


def shapes(thing: AnnotatedObject, end: int) -> Iterator[tuple[int, Numbers]]:
    """Frame and coordinates of an object in every image before ``end`` where it has a shape, as
    :func:`ecat.model.shapes.shape_at` tells them.
    """
    keys = first_images(thing.key_frames)
    for key, following in [*pairwise(keys), *[(key, None) for key in keys[-1:]]]:
        if not key.present:
            continue
        until = end if following is None else min(following.frame, end)
        blends = following is not None and _blends(thing, key, following)
        for frame in range(key.frame, until):
            if following is None or not blends or frame == key.frame:
                yield frame, key.coordinates
            else:
                yield frame, _between(key, following, frame)


def shape_in(thing: AnnotatedObject, keys: Sequence[KeyFrame], frame: int) -> Numbers | None:
    """The coordinates in one image, given the object's key frames as :func:`first_images` has them."""
    at = bisect_right(keys, frame, key=lambda key: key.frame) - 1
    if at < 0 or not keys[at].present:
        return None
    key, following = keys[at], keys[at + 1] if at + 1 < len(keys) else None
    if following is None or frame == key.frame or not _blends(thing, key, following):
        return key.coordinates
    return _between(key, following, frame)


def _between(key: KeyFrame, following: KeyFrame, frame: int) -> Numbers:
    share = (frame - key.frame) / (following.frame - key.frame)
    pairs = zip(key.coordinates, following.coordinates, strict=True)
    return tuple(a + share * (b - a) for a, b in pairs)


def _blends(thing: AnnotatedObject, key: KeyFrame, following: KeyFrame) -> bool:
    as_many = len(key.coordinates) == len(following.coordinates)
    return thing.interpolation == "linear" and following.present and as_many


def first_images(keys: Sequence[KeyFrame]) -> list[KeyFrame]:
    """Key frames in order, one for an image: the position before the first image shows that one, and the last said
    counts.
    """
    found = {max(key.frame, 0): replace(key, frame=max(key.frame, 0)) for key in keys}
    return [found[frame] for frame in sorted(found)]


def straight(thing: AnnotatedObject) -> list[KeyFrame]:
    """Key frames between which the shape moves in a straight line: one more at the end of each stretch in which it
    holds still, and then changes.
    """
    keys = first_images(thing.key_frames)
    made: list[KeyFrame] = []
    for key, following in [*pairwise(keys), *[(key, None) for key in keys[-1:]]]:
        made.append(key)
        jumps = following is not None and key.present and following.present
        if following is not None and jumps and not _blends(thing, key, following):
            last = following.frame - 1
            if last > key.frame:
                made.append(replace(key, frame=last, t_ns=None, foreign=()))
    return made


def simplified(keys: Sequence[KeyFrame]) -> tuple[KeyFrame, ...]:
    """The key frames, in order, without those that the others imply: on a straight line between those that are kept, to
    :data:`_STRAIGHT_PX`, or the same as before at the end.  Key frames that say more than a shape are kept.
    """
    kept: list[KeyFrame] = []
    slopes: list[Slopes] = []
    for key, following in [*pairwise(keys), *[(key, None) for key in keys[-1:]]]:
        if kept and _is_alike(kept[-1], key):
            if not key.present:
                continue
            if following is None or not _is_alike(key, following):
                # up to here and from here on the shape holds
                if kept[-1].coordinates == key.coordinates:
                    continue
            else:
                slopes = _narrowed(slopes, kept[-1], key)
                if _passes(slopes, kept[-1], following):
                    continue
        kept.append(key)
        slopes = []
    return tuple(kept)


def _is_alike(last: KeyFrame, key: KeyFrame) -> bool:
    """Whether a shape may go on to be the other without a key frame between them, and nothing else is said."""
    same = key.present == last.present and len(key.coordinates) == len(last.coordinates)
    return same and not key.foreign


def _narrowed(slopes: Sequence[Slopes], last: KeyFrame, key: KeyFrame) -> list[Slopes]:
    """How fast each coordinate may change from ``last`` on to pass by ``key``, and by those before."""
    steps = key.frame - last.frame
    pairs = zip(last.coordinates, key.coordinates, strict=True)
    mine = [((b - a - _STRAIGHT_PX) / steps, (b - a + _STRAIGHT_PX) / steps) for a, b in pairs]
    if not slopes:
        return mine
    return [(max(a, c), min(b, d)) for (a, b), (c, d) in zip(slopes, mine, strict=True)]


def _passes(slopes: Sequence[Slopes], last: KeyFrame, following: KeyFrame) -> bool:
    steps = following.frame - last.frame
    pairs = zip(last.coordinates, following.coordinates, slopes, strict=True)
    return all(least <= (b - a) / steps <= most for a, b, (least, most) in pairs)


def label_of(thing: AnnotatedObject) -> str:
    """What programs that sort things by labels sort an object under: its type, else its name."""
    return thing.semantic_type or thing.name or UNLABELLED


def is_typed(thing: AnnotatedObject) -> bool:
    """Whether :data:`TYPED` has to be said of an object."""
    return bool(thing.semantic_type) and thing.semantic_type in {thing.name, UNLABELLED}


def type_of(label: str, name: str, *, typed: bool) -> str:
    """The type of an object, given its label and name."""
    return label if typed or label not in {name, UNLABELLED} else ""


def box_around(points: Sequence[float]) -> tuple[float, float, float, float]:
    """The upright rectangle ``u, v, width, height`` around points ``u1, v1, u2, v2, ...``."""
    us, vs = points[::2], points[1::2]
    return min(us), min(vs), max(us) - min(us), max(vs) - min(vs)


def area_of(points: Sequence[float]) -> float:
    """The area of a polygon ``u1, v1, u2, v2, ...``."""
    us, vs = points[::2], points[1::2]
    crosses = (us[i - 1] * vs[i] - us[i] * vs[i - 1] for i in range(len(us)))
    return abs(sum(crosses)) / 2


def absences(runs: dict[int, Numbers], listed: Sequence[int]) -> Iterator[KeyFrame]:
    """Key frames of shapes by image, where ``listed`` are all images of which anything was said, in order: a shape ends
    with the first of them that has none.
    """
    there = False
    for frame in listed:
        shape = runs.get(frame)
        if shape is not None:
            yield KeyFrame(frame=frame, coordinates=shape)
        elif there:
            yield KeyFrame(frame=frame, present=False)
        there = shape is not None
