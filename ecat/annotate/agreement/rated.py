"""Ratings that stand in a table: one row per rating, with columns for the item, the rater and the answer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from ecat.annotate.agreement.ratings import Level, patterns_of
from ecat.annotate.agreement.report import Figures, coefficients, confusion_figures
from ecat.errors import FormatError

COLUMNS = {
    "item": ("item", "video_index", "video", "clip", "window", "demo_index", "index"),
    "rater": ("rater", "annotator", "judge", "coder", "author"),
    "answer": ("answer", "rating", "label", "score"),
    "truth": ("truth", "true_label", "gold"),
}
"""Names by which a column is found when none is given, the first that is there."""


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Which columns of a table are which; None is found by its usual names (:data:`COLUMNS`)."""

    item: Sequence[str] = ()
    rater: str | None = None
    answer: str | None = None
    truth: str | None = None


def rated_figures(
    ratings: pd.DataFrame,
    columns: Columns | None = None,
    *,
    blank: str | None = None,
    level: Level = "nominal",
) -> Figures:
    """Agreement of the raters, and with the truth if there is a column of it.

    Parameters
    ----------
    ratings : a row per rating. blank : the label that an empty answer stands for; by default it is no answer.
    level : of the answers; anything but ``nominal`` takes them for numbers.

    Raises
    ------
    FormatError : a column is missing, an item has two answers of one rater, an answer is not a number.
    """
    columns = columns or Columns()
    item = list(columns.item) or [_column(ratings, "item", None)]
    rater = _column(ratings, "rater", columns.rater)
    answer = _column(ratings, "answer", columns.answer)
    truth = columns.truth or next((name for name in COLUMNS["truth"] if name in ratings.columns), None)
    if missing := [name for name in (*item, *([truth] if truth else [])) if name not in ratings.columns]:
        raise _refused(f"there is no column {missing[0]}", ratings)
    if twice := int(ratings.duplicated([*item, rater]).sum()):
        raise _refused(f"{twice} items have more than one answer of the same rater", ratings)
    found = ratings[[*item, rater]].copy()
    found["answer"] = _answers(ratings[answer], blank, level)
    wide = found.set_index([*item, rater])["answer"].unstack(rater)
    patterns = patterns_of(map(_labels, wide.to_numpy(dtype=object).tolist()))
    figures = coefficients(patterns, level) | {"blank": int(found["answer"].isna().sum())}
    figures["raters_names"] = [str(name) for name in wide.columns]
    if truth:
        pairs = zip(ratings[truth].tolist(), found["answer"].tolist(), strict=True)
        figures["confusion"] = confusion_figures(Counter(map(_labels, pairs)))
    return figures


def _labels(values: Sequence[Any]) -> tuple[Any, ...]:
    return tuple(None if pd.isna(value) else value for value in values)


def _answers(answers: pd.Series, blank: str | None, level: Level) -> pd.Series:
    if level == "nominal":
        texts = answers.astype("string").str.strip()
        return texts.mask(texts == "").fillna(blank) if blank is not None else texts.mask(texts == "")
    try:
        return pd.to_numeric(answers).astype(float)
    except (ValueError, TypeError) as error:
        raise FormatError(
            "cannot compare the ratings",
            where=f"an answer is not a number: {error}",
            consequence="nothing was computed",
            fix="leave --level out for answers that are names",
        ) from None


def _column(ratings: pd.DataFrame, what: str, given: str | None) -> str:
    if given is not None:
        if given in ratings.columns:
            return given
        raise _refused(f"there is no column {given}", ratings)
    for name in COLUMNS[what]:
        if name in ratings.columns:
            return name
    raise _refused(f"which column is the {what} is not clear", ratings)


def _refused(why: str, ratings: pd.DataFrame) -> FormatError:
    return FormatError(
        "cannot compare the ratings",
        where=f"{why}; the columns are: {', '.join(map(str, ratings.columns))}",
        consequence="nothing was computed",
        fix="name the columns: --item, --rater, --answer, --truth",
    )
