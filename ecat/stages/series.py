"""Series: a session in which one kind of action is shown again and again, and the boxes are set back in between."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

FAMILIES = {"next": "approach", "toward": "approach", "past": "pass", "around": "pass", "away": "leave"}
"""What ways have in common: one may look like another, as ``next`` does like ``toward`` if its end is hidden."""


@dataclass(frozen=True)
class Series:
    """A family is shown in a series if it occurs ``times`` or more, in more than the ``share`` of the actions that
    went some way, and if never more than ``between`` others of them follow one another.  In an even mixture of all
    five ways, two families have two fifths.
    """

    times: int = 8
    share: float = 0.4
    between: int = 2


def shown_family(ways: Sequence[str], rules: Series) -> str | None:
    """The family of the ways that a session shows in a series, if it does.

    The most frequent one; between equals, the one that came first, since nothing is set back before it was moved.

    Parameters
    ----------
    ways : of all actions in their order; ``""`` where an action went no particular way.
    """
    families = [FAMILIES[way] for way in ways if way]
    if not families:
        return None
    family, times = Counter(families).most_common(1)[0]
    others = max(
        (len(list(run)) for shown, run in groupby(f == family for f in families) if not shown), default=0
    )
    enough = times >= rules.times and times > rules.share * len(families)
    return family if enough and others <= rules.between else None


def sets_back(ways: Sequence[str], rules: Series) -> list[bool]:
    """Which actions, by their ``ways``, only set up the next one of a series."""
    shown = shown_family(ways, rules)
    return [shown is not None and FAMILIES.get(way) != shown for way in ways]
