"""Surveys: made of events or windows, answered one item at a time, and read as a table."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from ecat.annotate.agreement.rated import rated_figures
from ecat.annotate.agreement.ratings import Level
from ecat.annotate.agreement.report import ratings_text
from ecat.annotate.agreement.report import table as table_lines
from ecat.errors import UsageError
from ecat.model.survey import Survey, SurveyAnswer, SurveyItem
from ecat.store import Session, find_sessions, open_session, staged_file
from ecat.store.surveys import append_answer, read_answers, read_survey, write_survey

MAX_ITEMS = 10_000
MAX_COMMENT = 10_000
NONE_OF_THEM = "None of the above"


@dataclass(frozen=True, kw_only=True)
class Source:
    """Which stretches of the sessions are asked about.

    Attributes
    ----------
    layer : events of this layer; of ``tier`` and ``type`` if they are given.
    window : start, step and duration in frames: windows instead of events (ECAT 2018 file format §2.13).
    whole : each session as one item, instead of either.
    """

    layer: str = "main"
    tier: str | None = None
    type: str | None = None
    window: tuple[int, int, int] | None = None
    whole: bool = False


def make_survey(root: Path, survey: Survey, source: Source, *, seed: int | None = None) -> Survey:
    """Write the survey called ``survey.name`` of the sessions at ``root``, with items from ``source``.

    Parameters
    ----------
    survey : without items. seed : shuffles them, the same way each time; None leaves them in the order of the sessions.

    Returns
    -------
    the survey with its items; ``choices`` that were not given are the types of the events, and "None of the above".

    Raises
    ------
    UsageError : there is nothing to ask about, or too much, or no choice.
    ExistsError : there is a survey of that name.
    """
    items = [
        item
        for path in find_sessions(root)
        for item in _items(open_session(path), _relative(root, path), source)
    ]
    if not 0 < len(items) <= MAX_ITEMS:
        where = f"{root}: {len(items):,} stretches are meant, of 1 to {MAX_ITEMS:,}"
        fix = "choose other events with --layer, --tier, --type, or windows with --window"
        raise UsageError(f"cannot make survey {survey.name}", where=where, fix=fix)
    if seed is not None:
        random.Random(seed).shuffle(items)
    choices = survey.choices or tuple(sorted({item.truth for item in items if item.truth}))
    if survey.kind == "choice":
        if not choices:
            fix = "name them with --choice"
            raise UsageError(
                f"cannot make survey {survey.name}", where="no event has a type to choose", fix=fix
            )
        choices = (*choices, NONE_OF_THEM) if NONE_OF_THEM not in choices else choices
    numbered = tuple(replace(item, id=str(number)) for number, item in enumerate(items))
    complete = replace(survey, items=numbered, choices=choices if survey.kind == "choice" else ())
    write_survey(root, complete)
    return complete


def _relative(root: Path, path: Path) -> str:
    return path.relative_to(root).as_posix()


def _items(session: Session, name: str, source: Source) -> Iterator[SurveyItem]:
    n_frames = session.manifest.n_frames
    if source.whole:
        yield SurveyItem(id="", session=name, start_frame=0, end_frame=n_frames)
    elif source.window is not None:
        start, step, duration = source.window
        if step < 1 or duration < 1 or start < 0:
            fix = "give a start from 0, a step and a duration from 1, in frames"
            raise UsageError("cannot make windows", where=f"{source.window}", fix=fix)
        for first in range(start, n_frames - duration + 1, step):
            yield SurveyItem(id="", session=name, start_frame=first, end_frame=first + duration)
    elif session.manifest.layer(source.layer) is not None:
        for event in session.layer(source.layer).events:
            wanted = source.tier in {None, event.tier} and source.type in {None, event.type}
            if event.segments and wanted and (source.tier is not None or event.parent is None):
                yield SurveyItem(
                    id="",
                    session=name,
                    start_frame=max(min(s.start_frame for s in event.segments), 0),
                    end_frame=max(s.end_frame for s in event.segments),
                    truth=event.type or None,
                )


def answer(
    root: Path, name: str, item: str, *, rater: str, said: str | int, comment: str = ""
) -> SurveyAnswer:
    """Note what ``rater`` says about ``item``; when this returns, it is on the disk.

    Raises
    ------
    UsageError : there is no such item, or the survey has no such answer.
    NotFoundError : there is no such survey.
    """
    survey = read_survey(root, name)
    if item not in {known.id for known in survey.items}:
        raise _refused(name, f"there is no item {item!r}", f"name one from 0 to {len(survey.items) - 1}")
    if not rater.strip() or len(rater) > 64 or not rater.isprintable():
        raise _refused(name, "whoever answers has no name", "give a name of 1 to 64 characters")
    if len(comment) > MAX_COMMENT:
        raise _refused(name, f"a comment of {len(comment):,} characters", f"write at most {MAX_COMMENT:,}")
    given = SurveyAnswer(
        item=item,
        rater=rater.strip(),
        answer=_checked(survey, said),
        comment=comment,
        time=datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
    )
    append_answer(root, name, given)
    return given


def _checked(survey: Survey, said: str | int) -> str | int:
    if survey.kind == "choice":
        if said in survey.choices:
            return said
        raise _refused(survey.name, f"{said!r} is no choice", f"choose one of: {', '.join(survey.choices)}")
    try:
        score = int(said)
    except ValueError:
        score = survey.least - 1
    if not survey.least <= score <= survey.most:
        fix = f"give a whole number from {survey.least} to {survey.most}"
        raise _refused(survey.name, f"{said!r} is no score", fix)
    return score


def _refused(name: str, why: str, fix: str) -> UsageError:
    return UsageError(f"cannot take the answer to survey {name}", where=why, fix=fix)


def results(root: Path, name: str) -> pd.DataFrame:
    """Every rater's last answer to every item, one row each.

    Columns: ``item``, ``session``, ``start_frame``, ``end_frame``, ``rater``, ``answer``, ``truth``, ``comment``,
    ``time``.
    """
    survey = read_survey(root, name)
    items = {item.id: item for item in survey.items}
    rows = [
        {
            "item": said.item,
            "session": items[said.item].session,
            "start_frame": items[said.item].start_frame,
            "end_frame": items[said.item].end_frame,
            "rater": said.rater,
            "answer": said.answer,
            "truth": items[said.item].truth,
            "comment": said.comment,
            "time": said.time,
        }
        for said in last_answers(read_answers(root, name))
        if said.item in items
    ]
    columns = ["item", "session", "start_frame", "end_frame", "rater", "answer", "truth", "comment", "time"]
    return pd.DataFrame(rows, columns=columns)


def last_answers(answers: Iterable[SurveyAnswer]) -> Sequence[SurveyAnswer]:
    """The last of each rater to each item, in the order in which they were first given."""
    found: dict[tuple[str, str], SurveyAnswer] = {}
    for said in answers:
        found[said.rater, said.item] = said
    return list(found.values())


def summarize(root: Path, name: str) -> dict[str, Any]:
    """The figures of a survey: agreement, confusion with the truth where it is known, or the scores by type.

    Raises
    ------
    UsageError : nobody has answered yet.
    """
    survey, table = read_survey(root, name), results(root, name)
    if table.empty:
        fix = f"ecat annotate {root}, or ecat survey answer"
        raise UsageError(f"cannot summarize survey {name}", where="nobody has answered yet", fix=fix)
    raters = sorted(table["rater"].unique())
    found: dict[str, Any] = {
        "survey": name,
        "question": survey.question,
        "kind": survey.kind,
        "items": len(survey.items),
    }
    found |= {
        "answers": len(table),
        "raters": {rater: int((table["rater"] == rater).sum()) for rater in raters},
    }
    known = table if survey.kind == "choice" and table["truth"].notna().any() else table.drop(columns="truth")
    level: Level = "nominal" if survey.kind == "choice" else "interval"
    found["agreement"] = rated_figures(known, level=level)
    if survey.kind == "score":
        found["scores"] = _scores(table)
    return found


def _scores(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Mean and standard deviation over the items' mean scores, by what the items are (thesis table 5.2)."""
    means = table.assign(truth=table["truth"].fillna("")).groupby(["truth", "item"])["answer"].mean()
    by_type = means.groupby("truth").agg(["count", "mean", "std"]).reset_index()
    return [
        {"type": row["truth"], "items": int(row["count"]), "mean": round(float(row["mean"]), 3)}
        | {"std": None if pd.isna(row["std"]) else round(float(row["std"]), 3)}
        for row in by_type.to_dict("records")
    ]


def summary_text(found: Mapping[str, Any]) -> str:
    """The figures of :func:`summarize` as a page."""
    raters = ", ".join(f"{name} {n}" for name, n in found["raters"].items())
    lines = [f"{found['survey']}: {found['question']}", f"{found['answers']:,} answers by {raters}"]
    if "scores" in found:
        rows = [
            [row["type"] or "(no type)", row["items"], row["mean"], row["std"]] for row in found["scores"]
        ]
        lines += ["", *table_lines(("scores", "items", "mean", "std"), rows)]
    return "\n".join([*lines, "", ratings_text(found["agreement"])])


def write_results(table: pd.DataFrame, dest: Path) -> None:
    """Write the answers as a table, ``.parquet`` or otherwise CSV.

    Raises
    ------
    ExistsError : ``dest`` is there.
    """
    with staged_file(dest) as staging:
        if dest.suffix.lower() == ".parquet":
            table.assign(answer=table["answer"].astype(str)).to_parquet(staging, index=False)
        else:
            table.to_csv(staging, index=False)
