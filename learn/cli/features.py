"""``ecat learn features``: sets of features by name, of sessions and of learning exports."""

from __future__ import annotations

import os.path
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ecat.cli.output import Output
from ecat.cli.text import columns, count
from ecat.cli.verb import verb
from ecat.errors import EcatError, InputError, UsageError, one_line

if TYPE_CHECKING:
    import pyarrow as pa

    from ecat.progress import Progress
    from learn.features.recordings import Recording
    from learn.features.sets import FeatureSet, Fitted

_FEW = 3
"""Recordings that a line names."""


@verb(
    "features",
    examples=(
        "ecat learn features --list",
        "ecat learn features --list --set ch4-qsr25",
        "ecat learn features my_session --set ch5-qualitative -o features.parquet",
        'ecat learn features my_project --set ch5-network --every 2 --objects "Shell" "Stella Artois" -o f.parquet',
        "ecat learn features exports/train --set ch4-qsr25 --fit planes.json -o train.parquet",
        "ecat learn features exports/test --set ch4-qsr25 --transform planes.json -o test.parquet",
    ),
)
@click.argument(
    "sources",
    nargs=-1,
    metavar="[SOURCE...]",
    type=click.Path(path_type=Path),
    help="Sessions, projects or workspaces; learning exports, or folders of them (*.txt).",
)
@click.option("--set", "name", metavar="NAME", help="The set of features (--list).")
@click.option("--list", "listed", is_flag=True, help="List the sets; with --set, the columns of one.")
@click.option(
    "--objects",
    nargs=2,
    metavar="A B",
    help="Of sessions, the two boxes, by id or by name; of more than two, the one that moves most and the nearest by "
    "default.",
)
@click.option(
    "--fit", type=click.Path(path_type=Path), metavar="FILE", help="Fit the transform to these recordings."
)
@click.option(
    "--transform", type=click.Path(path_type=Path), metavar="FILE", help="Take the one that --fit wrote."
)
@click.option("--fill", is_flag=True, help="Fill gaps in joints and markers in straight lines.")
@click.option(
    "--every",
    type=click.IntRange(min=1),
    default=1,
    metavar="Q",
    help="Of sets of chapter 5, one of every Q frames; 1 if not given.",
)
@click.option(
    "--output", "-o", "dest", type=click.Path(path_type=Path), metavar="FILE", help="The file to write."
)
def features(
    out: Output,
    *,
    sources: tuple[Path, ...],
    name: str | None,
    listed: bool,
    objects: tuple[str, str] | None,
    fit: Path | None,
    transform: Path | None,
    fill: bool,
    every: int,
    dest: Path | None,
) -> int:
    """Compute a set of features of sessions and of learning exports.

    The Parquet file has the columns session and frame (of a window, its first), and those of the set; what is not known
    is null.  Recordings of one name are called by their paths instead, below the folder that holds them all.

    Sets that take a transform (planes of most variance, a table) need it fitted to the recordings that models are
    trained on: --fit writes it, --transform applies it to others.  Features of chapter 5 take a session's own table,
    and a transform only of exports.

    Recordings of which a set cannot be made are named at the end, and the others written; the exit code is then 1.
    """
    from learn.features.sets import SETS, feature_set

    if listed:
        _list(out, SETS.values() if name is None else [feature_set(name)], alone=name is not None)
        return 0
    if not sources or name is None or dest is None:
        missing = "SOURCE" if not sources else "--set NAME" if name is None else "-o FILE"
        raise UsageError(
            "cannot compute features", where=f"there is no {missing}", fix="ecat learn features --help"
        )
    if fit is not None and transform is not None:
        raise UsageError("cannot compute features", where="--fit and --transform", fix="give one of them")
    wanted = feature_set(name)
    if (given := fit or transform) is not None and not wanted.transform:
        raise UsageError(
            f"cannot compute {name}",
            where=f"it takes no transform, and {given} was given",
            fix="leave it out",
        )
    with out.progress() as progress:
        read, failed, findings = _read(sources, objects or (), progress)
        recordings = _told_apart(read)
        if fill:
            recordings = [recording.filled() for recording in recordings]
        fitted = _fitted(wanted, recordings, fit, transform)
        done, more = _write(dest, wanted, recordings, fitted, every=every, fit=fit)
    failed += more
    findings += _gathered(recordings)
    rows_done = sum(done.values())
    text = f"wrote {count(rows_done, 'row')} of {count(len(done), 'recording')} to {dest}"
    lines = [text, *(f"  {said}" for said in findings), *(str(error) for error in failed)]
    data = {"path": str(dest), "rows": rows_done, "sessions": done, "findings": findings}
    out.result(data | {"failures": [e.to_dict() for e in failed]}, "\n".join(lines), failed=failed)
    return 1 if failed else 0


def _gathered(recordings: Sequence[Recording]) -> list[str]:
    """What is to be known of recordings, a line for all of which it is the same."""
    whose: dict[str, list[str]] = {}
    for recording in recordings:
        for said in recording.findings:
            whose.setdefault(said, []).append(recording.name)
    return [
        f"{', '.join(names[:_FEW])}{f' and {len(names) - _FEW:,} more' * (len(names) > _FEW)}: {said}"
        for said, names in whose.items()
    ]


def _list(out: Output, sets: Iterable[FeatureSet], *, alone: bool) -> None:
    """Print a line for each set; of one alone, also how its columns are to be read, and their names."""
    rows = [_described(one) for one in sets]
    head = ("set", "columns", "row", "made of", "transform", "source", "what")
    lines = [columns([head, *(tuple(str(row[key]) for key in head) for row in rows)])]
    if alone:
        lines += [textwrap.fill(rows[0]["named"], 110), *(f"  {column}" for column in rows[0]["names"])]
    out.result({"sets": rows}, "\n".join(lines))


def _described(one: FeatureSet) -> dict[str, Any]:
    transform = one.transform + ("" if one.always or not one.transform else " (exports)")
    return {
        "set": one.name,
        "columns": len(one.columns()),
        "row": one.per,
        "made of": one.inputs,
        "transform": transform or "-",
        "source": one.source,
        "what": one.what,
        "named": one.named,
        "names": list(one.columns()),
    }


def _read(
    sources: Sequence[Path], objects: tuple[str, ...], progress: Progress
) -> tuple[list[tuple[Path, Recording]], list[EcatError], list[str]]:
    """The recordings at the sources, each with its place; what cannot be read is told, unless nothing can, and what
    was left out.
    """
    from ecat.store import open_session
    from learn.features.recordings import read_export, read_session

    findings: list[str] = []
    each = (place for source in sources for place in _places(source, findings))
    places = list({place.resolve(): place for place in each}.values())
    found: list[tuple[Path, Recording]] = []
    failed: list[EcatError] = []
    for done, place in enumerate(places):
        progress("reading", done, len(places))
        try:
            if place.is_dir():
                found.append((place, read_session(open_session(place), objects)))
            else:
                found += [(place, recording) for recording in read_export(place)]
        except EcatError as error:
            failed.append(_about(str(place), error))
    progress("reading", len(places), len(places))
    if not found and failed:
        raise failed[0]
    return found, failed, list(dict.fromkeys(findings))


def _told_apart(read: Sequence[tuple[Path, Recording]]) -> list[Recording]:
    """Recordings, of which those of one name are called by their paths below the folder that holds all of these.

    Raises
    ------
    InputError : two of one export have one name.
    """
    often = Counter(recording.name for _, recording in read)
    alike = [place.absolute() for place, recording in read if often[recording.name] > 1]
    top = os.path.commonpath([place.parent for place in alike]) if alike else ""
    found: list[Recording] = []
    for place, recording in read:
        name = recording.name
        if often[name] > 1:
            name = place.absolute().relative_to(top).as_posix()
            if not place.is_dir():
                name = f"{name.removesuffix('.txt')}/{recording.name.partition('/')[2]}"
        found.append(replace(recording, name=name))
    if twice := [name for name, count in Counter(one.name for one in found).items() if count > 1]:
        raise InputError(
            "cannot tell recordings apart",
            where=f"two are called {twice[0]}",
            consequence="nothing was computed",
            fix="rename one of them",
        )
    return found


def _about(name: str, error: EcatError) -> EcatError:
    """The error, which says what it is about even if it did not."""
    if not re.search(rf"(?<!\w){re.escape(one_line(name))}(?!\w)", str(error)):
        error.where = ": ".join(part for part in (one_line(name), error.where) if part)
    return error


def _places(source: Path, findings: list[str]) -> Iterator[Path]:
    """Folders of sessions, or files of exports; which others were left out goes to ``findings``."""
    from ecat.cli.describe import sessions_at
    from ecat.errors import NotFoundError
    from ecat.formats.ecat2018.learning_export import learning_exports_below

    if source.is_file():
        yield source
        return
    exports, others = learning_exports_below(source) if source.is_dir() else ([], [])
    try:
        sessions = sessions_at(source)
    except NotFoundError as error:
        if not exports:
            error.where = "\n".join(line for line in (error.where, *others) if line)
            raise
        sessions = []
    if not sessions:
        findings += others
    yield from sessions or exports


def _fitted(
    wanted: FeatureSet, recordings: Sequence[Recording], fit: Path | None, transform: Path | None
) -> Fitted:
    from learn.features.transforms import KINDS, load_transform

    if fit is not None:
        return KINDS[wanted.transform].fit(recordings)
    return None if transform is None else load_transform(transform, wanted.transform)


def _write(
    dest: Path,
    wanted: FeatureSet,
    recordings: Sequence[Recording],
    fitted: Fitted,
    *,
    every: int,
    fit: Path | None,
) -> tuple[dict[str, int], list[EcatError]]:
    """Write the features of each recording, and tell how many rows each has; nothing if none has any.

    What was fitted is written to ``fit`` when they are there.
    """
    import pyarrow.parquet as pq

    from ecat.store import staged_file
    from learn.features.sets import features as features_of
    from learn.features.sets import schema_of
    from learn.features.transforms import save_transform

    done: dict[str, int] = {}
    failed: list[EcatError] = []
    tables = _tables(recordings, partial(features_of, wanted=wanted, transform=fitted, every=every), failed)
    first = next(tables, None)
    if first is None:
        raise (
            failed[0]
            if failed
            else UsageError(
                "cannot compute features",
                where="there are no recordings with frames",
                fix="give sessions or exports that have some",
            )
        )
    schema = first.schema.with_metadata(schema_of(wanted, first))
    with staged_file(dest) as staging:
        with pq.ParquetWriter(staging, schema, compression="zstd") as writer:
            for table in chain([first], tables):
                writer.write_table(table.cast(schema))
                done[str(table["session"][0])] = table.num_rows
        if fit is not None and fitted is not None:
            save_transform(fitted, fit)
    return done, failed


def _tables(
    recordings: Sequence[Recording], compute: Callable[[Recording], pa.Table], failed: list[EcatError]
) -> Iterator[pa.Table]:
    """The features of each recording; those of which there are none are told, but for a wrong call."""
    for recording in recordings:
        try:
            table = compute(recording)
        except UsageError:
            raise
        except EcatError as error:
            failed.append(_about(recording.name, error))
        else:
            if table.num_rows:
                yield table
