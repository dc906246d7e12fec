"""A survey: stretches of recordings, shown to people in an order of its own, with one question about each.

The question is answered by choosing (which of these sentences describes it best? thesis §5.3.5) or by a number (how
good is it, from 0 to 10? thesis §5.3.2), with a comment if the person likes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyItem:
    """One stretch, ``[start_frame, end_frame)`` of a session (its path inside the project, ``.`` for the only one).

    ``truth`` is what it really is, where that is known; whoever answers does not see it.
    """

    id: str
    session: str
    start_frame: int
    end_frame: int
    truth: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """What is asked, of which items, in their order.

    Attributes
    ----------
    kind : ``choice`` of one of ``choices``, or a ``score`` between ``least`` and ``most``.
    """

    name: str
    question: str
    kind: Literal["choice", "score"] = "choice"
    choices: tuple[str, ...] = ()
    least: int = 0
    most: int = 10
    items: tuple[SurveyItem, ...] = ()
    version: Literal["1"] = "1"


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyAnswer:
    """What ``rater`` said about an item; a later answer of the same rater to the same item replaces it.

    ``time`` is ISO 8601 in UTC.
    """

    item: str
    rater: str
    answer: str | int
    comment: str = ""
    time: str = ""
