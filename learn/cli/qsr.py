"""``ecat learn qsr``: qualitative spatial relations of the tracks in a Parquet file."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output, printable
from ecat.cli.text import count
from ecat.cli.verb import verb
from ecat.errors import EcatError, UsageError

if TYPE_CHECKING:
    import pyarrow as pa

    from ecat.store import Session
    from learn.features.qsr import Relation

NAMES = (
    *("cardir", "mos", "argd", "argprobd", "qtcbs", "qtccs", "qtcbcs"),
    *("rcc2", "rcc3", "rcc4", "rcc5", "rcc8", "ra", "mwe", "tpcc"),
)
"""As in the library, which is too slow to import for a help text."""


@verb(
    "qsr",
    examples=(
        "ecat learn qsr tracks.parquet --relation cardir -o cardir.parquet",
        "ecat learn qsr tracks.parquet --relation argd --thresholds close=0.1,near=0.5,far=2 -o argd.parquet",
        "ecat learn qsr tracks.parquet --relation qtccs --quantisation 0.01 --collapse --validate -o qtc.parquet",
        'ecat learn qsr my_session --relation cardir --of "Shell,Stella Artois" -o cardir.parquet',
        "ecat learn qsr my_session --relation qtccs --quantisation 0.003 --propose",
    ),
)
@click.argument(
    "tracks",
    type=click.Path(path_type=Path),
    help="A Parquet file with the columns track, frame, x1, y1, x2, y2; for boxes w1, h1, w2, h2; for tpcc x3, y3.  "
    "Or a session with poses (ecat process).",
)
@click.option("--relation", type=click.Choice(NAMES), required=True, help="What to compute.")
@click.option(
    "--output",
    "-o",
    "dest",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The Parquet file to write.",
)
@click.option(
    "--quantisation",
    type=float,
    metavar="Q",
    help="Movements (mos, qtc) or gaps (rcc) up to this length do not count; 0 if not given.",
)
@click.option(
    "--thresholds",
    multiple=True,
    metavar="NAME=T,...",
    help="Of argd, upper ends with or without names (close=10,near=20 or 10,20); of argprobd, means and standard "
    "deviations (close=10:5,near=20:10).  JSON will do as well.",
)
@click.option("--collapse", is_flag=True, help="Of qtc, leave out states equal to the one before.")
@click.option("--validate", is_flag=True, help="Of qtc, insert the states that continuous movement passes.")
@click.option(
    "--angle",
    type=float,
    metavar="RAD",
    help="Of qtccs and qtcbcs, the least angle to the line of sight "
    "for which the side of a movement counts; 0 if not given.",
)
@click.option(
    "--distance",
    type=float,
    metavar="D",
    help="Of qtcbcs, up to where both points are near each other and have four symbols; 1.22 if not given.",
)
@click.option(
    "--object",
    "object_",
    type=click.IntRange(1, 3),
    metavar="K",
    help="Of mos, which object; 1 if not given.",
)
@click.option(
    "--seed", type=int, metavar="N", help="Of argprobd, as of Python's random.seed; 0 if not given."
)
@click.option(
    "--of",
    multiple=True,
    metavar="A,B",
    help="Of a session, objects by id or name; may be repeated.  All in every order if not given.",
)
@click.option("--propose", is_flag=True, help="Of a session, write relations into its layer machine.")
@click.option(
    "--least",
    type=click.IntRange(min=1),
    metavar="N",
    help="Propose what holds for at least so many frames; 5 if not given.",
)
def qsr(
    out: Output,
    *,
    tracks: Path,
    relation: str,
    dest: Path | None,
    collapse: bool,
    validate: bool,
    object_: int | None,
    **given: Any,
) -> None:
    """Compute a qualitative spatial relation of tracks.

    The relations, their parameters and their values are those of QSRLib, of object 1 with respect to object 2 (tpcc:
    from origin 1 by relatum 2 to referent 3).  A row of the input is a frame of a track, in any order; a frame
    follows the one before it, whatever numbers are missing between.  The result has the columns track, frame and one
    named after the relation, and is ordered by track and frame; a value is null where an object's position is.

    Relations of movement (mos and qtc) are told at the later of two frames, so the first frame of a track has no row.
    With --collapse or --validate, frame is the place of a state in the chain of its track, from 1, and what is not
    known has no place.  Values are as QSRLib prints them: qtccs "-,0,+,0", ra "<,mi".  Of rcc and ra, an object without
    a size is a point, and that is said.

    Of a session, the relation is that of its objects seen from above, on the table; the result has a row for each
    frame of each pair, with the columns a, b, c, relation and value.  With --propose, what holds for some frames
    becomes a relation in the layer machine, with the predicate cardir=ne, as what `ecat process` proposes; those of the
    same relation that were proposed before are replaced.
    """
    from ecat.store.manifest import SESSION_FILE
    from learn.features.qsr.tracks import relation_named

    of_session = {name: given.pop(name) for name in ("of", "propose", "least")}
    found, chained = relation_named(relation, collapse=collapse, validate=validate), (collapse, validate)
    if (tracks / SESSION_FILE).is_file():
        _of_session(out, tracks, dest, found, given, object_=object_, chained=chained, **of_session)
    elif there := _sessions_in(tracks):
        raise _not_one(relation, tracks, there)
    elif dest is None or any(of_session.values()):
        wrong = "--of, --propose and --least are about sessions" if dest else "no file to write is given"
        fix = "give a session, or -o FILE"
        raise UsageError(f"cannot compute {relation} of {tracks}", where=wrong, fix=fix)
    else:
        _of_file(out, tracks, dest, found, given, object_=object_, chained=chained)


def _sessions_in(folder: Path) -> list[Path]:
    """The sessions that a folder holds which is none itself."""
    from ecat.errors import NotFoundError
    from ecat.store import find_sessions

    try:
        return [] if folder.is_file() else find_sessions(folder)
    except NotFoundError:
        return []


def _not_one(relation: str, folder: Path, there: Sequence[Path]) -> EcatError:
    """Why nothing is computed of a folder that holds sessions."""
    names = ", ".join(map(str, there[:3])) + (f" and {len(there) - 3:,} more" if len(there) > 3 else "")
    return UsageError(
        f"cannot compute {relation} of {folder}",
        where=f"it holds {count(len(there), 'session')}: {names}",
        fix=f"name one of them: ecat learn qsr {there[0]}",
    )


def _of_file(
    out: Output,
    tracks: Path,
    dest: Path,
    relation: Relation,
    given: Mapping[str, Any],
    *,
    object_: int | None,
    chained: tuple[bool, bool],
) -> None:
    from learn.features.qsr.files import write_relation

    if object_ is not None and relation.objects != 1:
        raise _not_of(relation, "object")
    parameters = _parameters(relation, given)
    collapse, validate = chained
    with out.progress() as progress:
        written = write_relation(
            tracks,
            dest,
            relation,
            parameters,
            objects=(object_ or 1,) if relation.objects == 1 else (1, 2, 3),
            collapse=collapse,
            validate=validate,
            progress=progress,
        )
    text = f"wrote {count(written.rows, 'row')} of {count(written.tracks, 'track')} to {dest}"
    if written.missing:
        text += f"; {written.missing:,} without a value, where a position is not known"
    data = {"path": str(dest), "rows": written.rows, "tracks": written.tracks, "missing": written.missing}
    missing = ", ".join(f"w{k}, h{k}" for k in written.points)
    notes = [
        *_points_said(
            relation, [str(k) for k in written.points], f"{tracks} does not have both of {missing}"
        ),
        *_no_rows_said(relation, written.rows),
    ]
    _note(out, notes)
    out.result(data | {"findings": notes}, text)


def _of_session(
    out: Output,
    path: Path,
    dest: Path | None,
    relation: Relation,
    given: Mapping[str, Any],
    *,
    object_: int | None,
    chained: tuple[bool, bool],
    of: tuple[str, ...],
    propose: bool,
    least: int | None,
) -> None:
    """Write a session's qualitative track to a file, into its machine's layer, or both."""
    from ecat.store import open_session
    from learn.features.qsr import qualitative_tracks
    from learn.features.qsr.intervals import LEAST, author_of, relations_of
    from learn.recognize.proposals import replace_proposals

    what = f"cannot compute {relation.name} of {path}"
    if dest is None and not propose:
        raise UsageError(what, where="it is not said where to write it", fix="-o FILE, --propose, or both")
    if object_ is not None or (propose and any(chained)) or (least and not propose):
        where = "--object is about files, --least about --propose, and states of a chain have no frames to propose"
        raise UsageError(what, where=where, fix="leave it out")
    session = open_session(path)
    collapse, validate = chained
    sizes = _sizes(session) if relation.of_boxes else {}
    track = qualitative_tracks(
        session,
        relation.name,
        of=_objects_of(session, of),
        sizes_m=sizes,
        collapse=collapse,
        validate=validate,
        **_parameters(relation, given),
    )
    named = {str(name) for name in track["a"].unique().to_pylist()}
    sizeless = sorted(named - set(sizes)) if relation.of_boxes else []
    notes = [
        *_points_said(relation, sizeless, "no box is known that they are"),
        *_no_rows_said(relation, track.num_rows),
    ]
    data: dict[str, Any] = {"session": str(path), "rows": track.num_rows, "findings": notes}
    said: list[str] = []
    if dest is not None:
        _write_track(track, dest)
        data["path"] = str(dest)
        said.append(f"wrote {count(track.num_rows, 'row')} to {dest}")
    if propose:
        found = relations_of(session, track, least=least or LEAST)
        replaced = replace_proposals(session, author_of(relation.name), relations=found)
        data |= {"proposed": replaced.added, "removed": replaced.removed, "kept": replaced.kept}
        said.append(f"proposed {count(replaced.added, 'relation')} in {path}")
    _note(out, notes)
    out.result(data, "\n".join(said))


def _points_said(relation: Relation, names: Sequence[str], why: str) -> list[str]:
    if not names:
        return []
    what = f"object {names[0]} is a point" if len(names) == 1 else f"objects {', '.join(names)} are points"
    return [f"in {relation.name}, {what}: {why}"]


def _no_rows_said(relation: Relation, rows: int) -> list[str]:
    if rows:
        return []
    return ["there are no rows" + (": no frame follows another in its track" if relation.frames > 1 else "")]


def _note(out: Output, notes: Sequence[str]) -> None:
    """Say what is to be known of a result, beside it."""
    if not out.quiet:
        for note in notes:
            click.echo(printable(f"note: {note}"), err=True)


def _objects_of(session: Session, of: tuple[str, ...]) -> list[tuple[str, ...]] | None:
    """Ids for ids or names; what is neither is left for the relation to refuse."""
    ids = {row["name"]: row["object_id"] for row in session.objects.to_arrow().to_pylist() if row["name"]}
    return [tuple(ids.get(word.strip(), word.strip()) for word in words.split(",")) for words in of] or None


def _sizes(session: Session) -> dict[str, tuple[float, float, float]]:
    """Edges of the session's boxes, by object; nominal ones where they were not measured, as in poses."""
    from ecat.model.prototype import NOMINAL_BOXES
    from ecat.process import kept_prototypes
    from ecat.process.inputs import annotated_objects, box_objects

    boxes = kept_prototypes(session) or NOMINAL_BOXES
    return {
        name: box.size_m
        for name, box in zip(box_objects(annotated_objects(session), boxes), boxes, strict=True)
    }


def _write_track(track: pa.Table, dest: Path) -> None:
    import pyarrow.parquet as pq

    from ecat.store import staged_file

    with staged_file(dest) as staging:
        pq.write_table(track, staging, compression="zstd", store_schema=False)


def _parameters(relation: Relation, given: Mapping[str, Any]) -> dict[str, Any]:
    """What the function of the relation takes, of what was given."""
    from learn.features.qsr import seeded

    found: dict[str, Any] = {}
    for option, name in (("quantisation", "threshold"), ("angle", "angle"), ("distance", "distance")):
        if (value := given[option]) is None:
            continue
        if name in relation.parameters:
            found[name] = value
        elif value or option == "distance":  # without any, 0 is what is done anyway
            raise _not_of(relation, option)
    if "generator" in relation.parameters:
        found["generator"] = seeded(given["seed"] or 0)
    elif given["seed"] is not None:
        raise _not_of(relation, "seed")
    by_name = next((name for name in ("thresholds", "bands") if name in relation.parameters), None)
    if by_name is None:
        if given["thresholds"]:
            raise _not_of(relation, "thresholds")
        return found
    pairs = [pair for text in given["thresholds"] for pair in _pairs(text)]
    if len({name for name, _ in pairs}) < len(pairs):
        raise _unreadable(", ".join(given["thresholds"]), "a name occurs twice", by_name)
    found[by_name] = {name: _number(text, by_name) for name, text in pairs}
    if not pairs:
        fix = "--thresholds close=10:5,near=20:8" if by_name == "bands" else "--thresholds close=10,near=20"
        raise UsageError(f"cannot compute {relation.name}", where="it has no thresholds of its own", fix=fix)
    return found


def _pairs(text: str) -> list[tuple[str, str]]:
    """Names and what they stand for; what has no name is named as it was written."""
    if not text.lstrip().startswith("{"):
        words = [word for word in re.split(r"[,;\s]+", text) if word]
        return [(name or value, value) for name, _, value in (word.rpartition("=") for word in words)]
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise _unreadable(text, str(error), "thresholds") from None
    return [
        (name, ":".join(map(str, value)) if isinstance(value, list) else str(value))
        for name, value in document.items()
    ]


def _number(text: str, by_name: str) -> float | tuple[float, float]:
    try:
        numbers = [float(part) for part in text.split(":")]
    except ValueError:
        raise _unreadable(text, "not a number", by_name) from None
    if len(numbers) != (2 if by_name == "bands" else 1) or not all(map(math.isfinite, numbers)):
        expected = "a mean and a standard deviation" if by_name == "bands" else "one finite number"
        raise _unreadable(text, f"expected {expected}", by_name)
    return (numbers[0], numbers[1]) if by_name == "bands" else numbers[0]


def _unreadable(text: str, reason: str, by_name: str) -> UsageError:
    example = "close=10:5,near=20:8" if by_name == "bands" else "close=10,near=20"
    return UsageError(f"cannot read the thresholds {text[:80]}", where=reason, fix=f"--thresholds {example}")


def _not_of(relation: Relation, option: str) -> UsageError:
    return UsageError(
        f"cannot compute {relation.name} with --{option}",
        where=f"{relation.name} has no such parameter",
        fix=f"leave out --{option}",
    )
