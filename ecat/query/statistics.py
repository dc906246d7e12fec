"""What is in a project: how much of what, how long, how much of it is known, and how far annotators agree.

Every figure that can be one is a question in SQL, so that who wants another one has something to begin with.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecat.annotate import agreement
from ecat.errors import CorruptError, EcatError, NotFoundError, UsageError
from ecat.progress import Progress, silent
from ecat.query.database import damaged_sessions, open_database

Rows = list[dict[str, Any]]

QUESTIONS: Mapping[str, str] = {
    "sessions": """
        select count(*) as sessions, sum(frames)::bigint as frames, round(sum(duration_s), 3) as duration_s,
               count(*) filter (duration_s is null) as without_clock,
               count(*) filter (len(layers) = 0) as not_annotated
        from sessions""",
    "events": """
        select layer, if(parent is null, 'action', 'part') as level, type, count(*) as events,
               count(distinct session) as sessions,
               round(sum(end_ns - start_ns) / 1e9, 3) as total_s,
               round(median(end_ns - start_ns) / 1e9, 3) as median_s,
               round(min(end_ns - start_ns) / 1e9, 3) as shortest_s,
               round(max(end_ns - start_ns) / 1e9, 3) as longest_s,
               count(*) filter (unsure) as unsure
        from events group by all order by layer, level, events desc, type""",
    "lengths": """
        select layer, type, round((end_ns - start_ns) / 1e9, 3) as seconds from events
        where parent is null and end_ns is not null order by layer, type, seconds limit 100000""",
    "annotated": """
        select layer, count(distinct session) as sessions, sum(end_frame - start_frame)::bigint as frames,
               round(sum(end_frame - start_frame) filter (recorded is not null)
                     / (select sum(frames) from sessions), 4) as share
        from (
            -- stretches that overlap are counted once
            select layer, session, recorded,
                   greatest(start_frame, coalesce(max(end_frame) over before, 0)) as start_frame, end_frame
            -- of those that reach beyond the recording, where it is known how long that is, what lies in it
            from (select layer, session, recorded, s.start_frame, least(s.end_frame, recorded) as end_frame
                  from event_segments s join events e using (session, layer, event_id)
                       join (select session, nullif(frames, 0) as recorded from sessions) using (session)
                  where e.parent is null)
            window before as (partition by layer, session order by start_frame, end_frame
                              rows between unbounded preceding and 1 preceding)
        ) where end_frame > start_frame group by layer order by layer""",
    "objects": """
        select layer, kind, count(*) as objects, count(distinct session) as sessions
        from objects group by all order by layer, kind""",
    "relations": """
        select layer, predicate, source, count(*) as relations, count(distinct session) as sessions
        from relations group by all order by layer, relations desc, predicate""",
    "places": """
        select coalesce(o.name, p.object_id) as object, count(distinct p.session) as sessions, count(*) as frames,
               round(count(*) filter (p.source = 'observed') / count(*), 4) as observed,
               round(count(*) filter (p.source = 'interpolated') / count(*), 4) as interpolated,
               round(count(*) filter (p.source is null) / count(*), 4) as not_known,
               round(median(p.sigma_m) * 1000, 3) as median_sigma_mm
        from poses p left join (select session, object_id, any_value(name) as name from objects group by all) o
             using (session, object_id)
        group by all order by object""",
}
"""Every part of the statistics, and the question that it answers."""

ASKED = ("events", "event_segments", "objects", "relations", "poses")
"""The tables that they read."""


@dataclass(frozen=True, kw_only=True)
class Statistics:
    """What was counted.

    ``parts``: rows by part, in the order of :data:`QUESTIONS`.  ``agreement``: a row for each tier, none for one
    annotator.  ``failures``: sessions that could not be opened or read.
    """

    parts: Mapping[str, Rows]
    agreement: Rows
    failures: tuple[tuple[Path, EcatError], ...] = ()


def statistics(path: Path, *, progress: Progress = silent) -> Statistics:
    """Count what the sessions at ``path`` hold; those that cannot be read are named in the answer.

    Raises
    ------
    NotFoundError, MissingExtraError : as of :func:`ecat.query.open_database`.
    CorruptError : no session can be read.
    """
    try:
        parts, failures = _counted(path, {}, progress)
    except CorruptError:
        damaged = damaged_sessions(path, ASKED, progress=progress)
        if not damaged:
            raise
        parts, failures = _counted(path, damaged, progress)
    return Statistics(parts=parts, agreement=_agreement(path, progress), failures=failures)


def _counted(
    path: Path, left_out: Mapping[Path, EcatError], progress: Progress
) -> tuple[dict[str, Rows], tuple[tuple[Path, EcatError], ...]]:
    with open_database(path, left_out=left_out, progress=progress) as database:
        parts = {name: database.ask(question).rows() for name, question in QUESTIONS.items()}
        return parts, database.failures


def _agreement(path: Path, progress: Progress) -> Rows:
    try:
        compared = agreement.agree([path], progress=progress)
    except (UsageError, NotFoundError):  # one annotator has nobody to agree with
        return []
    found = agreement.figures(compared.agreement)
    raters = ", ".join(found["raters"])
    return [
        {
            "tier": tier or "(no tier)",
            "annotators": raters,
            "sessions": found["sessions"],
            "cohen_kappa": values["cohen_kappa"],
            "fleiss_kappa": values["fleiss_kappa"],
            "krippendorff_alpha": values["krippendorff_alpha"],
        }
        for tier, values in found["tiers"].items()
    ]
