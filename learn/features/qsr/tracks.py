"""Qualitative tracks as Arrow tables, of sessions and of tables of positions."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import permutations
from typing import Any

import numpy as np
import pyarrow as pa

from ecat.errors import InputError, UsageError
from ecat.geometry.transforms import matrix_from_quaternion
from ecat.process.inputs import sane
from ecat.store import Session
from ecat.tables import Column, TableSchema
from learn.features.qsr.codes import MISSING, Codes, Floats, to_arrow
from learn.features.qsr.continuity import chains, positions
from learn.features.qsr.relations import RELATIONS, Relation

_NAME = pa.dictionary(pa.int32(), pa.string())
_COUNT = {1: "one object", 2: "two objects, not the same", 3: "three objects, all different"}
_FIXES = {
    2: "choose a relation of one object (mos), or a session in which two boxes were seen",
    3: "choose a relation of two objects, or a session in which three boxes were seen",
}
QUALITATIVE_TRACKS = TableSchema(
    "qualitative_tracks",
    "Qualitative relations of objects, one row per frame, or per state of a chain.",
    (
        Column("track", _NAME, "the recording"),
        Column("frame", pa.int32(), "image of the annotated video, from zero; null in a chain", "", "", True),
        Column("position", pa.int32(), "place in the chain, from 1; null outside of chains", "", "", True),
        Column("a", _NAME, "the object of which it is said; of tpcc, the origin"),
        Column("b", _NAME, "the object with respect to which; of tpcc, the relatum", "", "", True),
        Column("c", _NAME, "of tpcc, the referent", "", "", True),
        Column("relation", _NAME, "name of the relation, as in QSRLib"),
        Column("value", _NAME, "what holds; null where an object was not seen", "", "", True),
    ),
    ("track", "relation", "a", "b", "c", "frame", "position"),
)


def qualitative_tracks(
    session: Session,
    name: str,
    *,
    of: Iterable[tuple[str, ...]] | None = None,
    sizes_m: Mapping[str, tuple[float, float, float]] | None = None,
    collapse: bool = False,
    validate: bool = False,
    **parameters: Any,
) -> pa.Table:
    """One relation of a session's objects, seen from above: in the ``table`` frame, x to the right and y away.

    Poses are those of ``poses_smooth`` if the session has it, else of ``poses``.

    Parameters
    ----------
    name : one of :data:`RELATIONS`.
    of : ids of objects, as many as the relation has and none twice, for each track; by default all in every order.
    sizes_m : edges of the objects' boxes by id, for relations of boxes: those of the rectangle parallel to the
        table's axes around the box; without, they are points.
    collapse, validate : make a chain of QTC states.
    parameters : of the relation's function, in metres.

    Returns
    -------
    Table of :data:`QUALITATIVE_TRACKS`.  Movement is not known in the frame after one that has no poses.

    Raises
    ------
    NotFoundError : the session has no poses yet.
    InputError : it has poses of fewer objects than the relation is of.
    UsageError : no such relation or object; chains of what is not QTC.
    """
    relation = relation_named(name, collapse=collapse, validate=validate)
    frames, places = _places(session, relation, sizes_m or {})
    if of is None:
        _require_enough(relation, places, session)
    wanted = list(permutations(sorted(places), relation.objects)) if of is None else list(dict.fromkeys(of))
    _require_objects(relation, wanted, places)
    follows = np.diff(np.asarray(frames)) == 1
    schema = QUALITATIVE_TRACKS.arrow
    tables: list[pa.Table] = []
    for ids in wanted:
        codes = relation.compute(*(places[each] for each in ids), **parameters)
        if relation.frames > 1:
            codes = np.where(follows, codes, MISSING).astype(np.uint8)
        values = relation.values_of(parameters)
        track = _track(codes, frames[relation.frames - 1 :], values, collapse=collapse, validate=validate)
        names = dict(zip("abc", ids, strict=False))
        constant = {"track": session.name, "relation": name, **{each: names.get(each) for each in "abc"}}
        columns = {
            key: pa.repeat(pa.scalar(value, pa.string()), len(track)) for key, value in constant.items()
        }
        columns |= {key: track[key] for key in track.column_names}
        tables.append(
            pa.table([columns[key].cast(schema.field(key).type) for key in schema.names], schema=schema)
        )
    return pa.concat_tables(tables).unify_dictionaries() if tables else schema.empty_table()


def relation_named(name: str, *, collapse: bool = False, validate: bool = False) -> Relation:
    """The relation, if it can form the chains asked for.

    Raises
    ------
    UsageError : no such relation; chains of what is not QTC.
    """
    relation = RELATIONS.get(name)
    if relation is None:
        raise UsageError(
            f"cannot compute {name}", where=f"known are {', '.join(RELATIONS)}", fix="choose one of these"
        )
    if (collapse or validate) and not relation.chains:
        raise UsageError(
            f"cannot make a chain of {name}",
            where="only states of qtcbs, qtccs and qtcbcs are collapsed and validated",
            fix="leave out collapse and validate",
        )
    return relation


def _require_enough(relation: Relation, there: Collection[str], session: Session) -> None:
    if len(there) >= relation.objects:
        return
    known = ", ".join(sorted(there)) or "nothing"
    raise InputError(
        f"cannot compute {relation.name} of {session.name}",
        where=f"it is of {_COUNT[relation.objects]}; of this session, poses are known of {known} only",
        consequence="nothing was computed",
        fix=_FIXES.get(relation.objects, "ecat process the session"),
    )


def _require_objects(relation: Relation, wanted: Iterable[tuple[str, ...]], there: Collection[str]) -> None:
    for ids in wanted:
        if len(ids) != relation.objects or len(set(ids)) != len(ids) or not set(ids) <= set(there):
            named, known = " and ".join(each or "nothing" for each in ids), ", ".join(sorted(there))
            raise UsageError(
                f"cannot compute {relation.name} of {named or 'nothing'}",
                where=f"{relation.name} is of {_COUNT[relation.objects]}; of this session, {known or 'none'}",
                fix="choose among these",
            )


def _track(
    codes: Codes,
    frames: pa.Array[Any],
    values: tuple[str, ...],
    *,
    collapse: bool,
    validate: bool,
) -> pa.Table:
    if collapse or validate:
        one = np.zeros(len(codes), np.int32)
        codes, one = chains(codes, one, values, collapse=collapse, validate=validate)
        frame, position = pa.nulls(len(codes), pa.int32()), pa.array(positions(one))
    else:
        frame, position = frames, pa.nulls(len(codes), pa.int32())
    return pa.table({"frame": frame, "position": position, "value": to_arrow(codes, values)})


def _places(
    session: Session, relation: Relation, sizes_m: Mapping[str, tuple[float, float, float]]
) -> tuple[pa.Array[Any], dict[str, Floats]]:
    """Frames, and of every object points, in space for argd, or boxes; NaN where it was not seen."""
    table = "poses_smooth" if session.has_table("poses_smooth") else "poses"
    columns = ["frame", "object_id", "x", "y", "z", "qx", "qy", "qz", "qw"]
    poses = sane(session.table(table, columns=columns).to_arrow())
    frames = np.unique(poses["frame"].to_numpy())
    places: dict[str, Floats] = {}
    ids = np.array(poses["object_id"].cast(pa.string()).to_pylist())
    for each in sorted(set(ids.tolist())):
        rows = poses.filter(pa.array(ids == each))
        pose = np.array([rows[key].to_numpy() for key in ("x", "y", "z", "qx", "qy", "qz", "qw")]).T
        found = np.full((len(frames), 7), np.nan)
        pose[(pose[:, 3:] == 0).all(axis=1)] = np.nan  # turned in no way
        found[np.searchsorted(frames, rows["frame"].to_numpy())] = pose
        places[each] = found[:, : 3 if relation.in_space else 2]
        if relation.of_boxes and each in sizes_m:
            places[each] = np.hstack([found[:, :2], _footprint(found[:, 3:], sizes_m[each])])
    return pa.array(frames.astype(np.int32)), places


def _footprint(quaternion: Floats, size_m: tuple[float, float, float]) -> Floats:
    """(n, 2) width and height, seen from above, of the rectangle around a turned box."""
    return np.abs(matrix_from_quaternion(quaternion)[:, :2]) @ np.array(size_m)
