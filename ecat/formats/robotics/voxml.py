"""VoxML entries of the objects of a session, a file each: what is known of a thing from having seen it handled.

Source: Pustejovsky and Krishnaswamy, VoxML: A visualization modeling language, LREC 2016, and ECAT 2018 file format
§1.9.  An entry is about a kind of thing: objects of the same semantic type (without one, of the same name) share it.

Carried: predicate; head, concavity and symmetries of boxes and of the table; which way is up; size against an agent;
that it can be moved, if it was; affordances that were seen (events it took part in, things that lay on it).  Left
behind: sizes in metres, who did what when.  Nothing is said of what was not seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ecat.errors import NotFoundError
from ecat.formats.ecat2018.voxml import (
    Embodiment,
    Habitat,
    Lex,
    ObjectType,
    VoxmlEntry,
    write_voxml,
)
from ecat.formats.episodes import chosen_layer
from ecat.formats.format import Format
from ecat.formats.options import option
from ecat.formats.robotics import tracks
from ecat.formats.robotics.scene import (
    Thing,
    Things,
    file_names,
    slug,
    table_fits,
    table_outlines,
    things_of,
)
from ecat.geometry.transforms import known
from ecat.model import Layer
from ecat.model.annotation import Event
from ecat.progress import Progress
from ecat.store import Session, write_new_file

_UPRIGHT = Habitat(intrinsic=(("UP", "align(Y,E_Y)"), ("TOP", "top(+Y)")))
_SMALL_M, _LARGE_M = 0.5, 2.5
_MOVED_M = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class VoxmlOptions:
    """Whose word is taken."""

    layer: str = option("", "the layer of events and relations; nothing: gold, else main, else another")


@dataclass
class _Kind:
    """What is known of the objects that share an entry."""

    pred: str
    things: list[Thing] = field(default_factory=list[Thing])
    affordances: dict[str, None] = field(default_factory=dict[str, None])
    moved: bool = False


def part(
    session: Session, label: str, dest: Path, options: VoxmlOptions, progress: Progress
) -> tuple[str, ...]:
    """Write a folder with an entry for each kind of object.

    Raises
    ------
    NotFoundError : there are no objects, or no layer of that name.
    """
    progress(f"writing {label}", 0, 1)
    things, layer = things_of(session), chosen_layer(session, options.layer)
    kinds = _kinds(thing for thing in things.values() if thing.kind != "rig")
    if not kinds:
        raise NotFoundError(
            f"cannot write VoxML entries of {label}",
            where=f"{session.name}: there are no objects",
            consequence="this session was not written",
            fix="annotate objects first",
        )
    of = {thing.id: kind for kind in kinds.values() for thing in kind.things}
    for key in _moved(session):
        if key in of:
            of[key].moved = True
    _take_part(layer, of)
    surface_m = _surface_m(session)
    dest.mkdir()
    for name, kind in zip(file_names(list(kinds)), kinds.values(), strict=True):
        write_new_file(dest / f"{name}.xml", [write_voxml(_entry(kind, surface_m))])
    return tuple(_findings(things, kinds.values()))


def _kinds(things: Iterable[Thing]) -> dict[str, _Kind]:
    found: dict[str, _Kind] = {}
    for thing in things:
        pred = slug(thing.semantic_type or thing.name).lower()
        found.setdefault(pred, _Kind(pred)).things.append(thing)
    return dict(sorted(found.items()))


def _moved(session: Session) -> Iterator[str]:
    """The boxes that were at two places further apart than a box is measured wrongly."""
    table = tracks.best_poses(session)
    if table is None:
        return
    ids = tracks.box_ids(session, table)
    low, high = np.full((len(ids), 3), np.inf), np.full((len(ids), 3), -np.inf)
    for stretch in tracks.poses(session, table, ids):
        places = np.where(known(stretch.centre)[..., None], stretch.centre, np.nan)
        low = np.fmin(low, np.fmin.reduce(places, axis=0, initial=np.inf))
        high = np.fmax(high, np.fmax.reduce(places, axis=0, initial=-np.inf))
    yield from (key for key, span in zip(ids, high - low, strict=True) if span.max() > _MOVED_M)


def _take_part(layer: Layer, of: dict[str, _Kind]) -> None:
    """Affordances: what objects were the theme or the landmark of, and what lay on them."""
    for event in layer.events:
        for key, formula in _formulas(event):
            if key in of:
                of[key].affordances[formula] = None
    for relation in layer.relations:
        if relation.predicate.upper() == "ON" and relation.polarity and len(relation.targets) == 2:
            below = of.get(relation.targets[1])
            if below is not None:
                below.affordances["H->[put(x,on([1]))]support([1],x)"] = None


def _formulas(event: Event) -> Iterator[tuple[str, str]]:
    """For each object of an event, what it affords; x is who acts, [1] the object."""
    roles = {role.name.lower(): role.target for role in event.roles if role.kind == "object"}
    theme, landmark = roles.get("theme"), roles.get("landmark")
    if not event.type or theme is None:
        return
    action = slug(event.type)
    if landmark is None:
        yield theme, f"H->[{action}(x,[1])]"
    else:
        yield theme, f"H->[{action}(x,[1],y)]"
        yield landmark, f"H->[{action}(x,y,[1])]"


def _surface_m(session: Session) -> float | None:
    """The table's greatest extent, metres."""
    fits = table_fits(session)
    rings = table_outlines(session, fits) if fits is not None else []
    return float(max(np.ptp(ring, axis=0).max() for _, ring in rings)) if rings else None


def _entry(kind: _Kind, surface_m: float | None) -> VoxmlEntry:
    first = kind.things[0]
    shape, habitat, extent_m, types = ObjectType(), Habitat(), None, ("physobj",)
    if first.kind == "marker_box":
        shape = ObjectType("rectangular_prism[1]", (), "Flat", ("X", "Y", "Z"), ("XY", "XZ", "YZ"))
        habitat, types = _UPRIGHT, ("physobj", "artifact")
        extent_m = max(first.size_m) if first.size_m is not None else None
    elif first.is_surface:
        shape, habitat, extent_m = ObjectType("sheet[1]", (), "Flat"), _UPRIGHT, surface_m
    return VoxmlEntry(
        lex=Lex(kind.pred, types),
        type=shape,
        habitat=habitat,
        affordances=tuple(kind.affordances),
        embodiment=Embodiment(_scale(extent_m), True if kind.moved else None),
    )


def _scale(extent_m: float | None) -> str | None:
    """Size against somebody who acts: smaller than half a metre, larger than a person, or between."""
    if extent_m is None:
        return None
    return "<agent" if extent_m < _SMALL_M else "agent" if extent_m < _LARGE_M else ">agent"


def _findings(things: Things, kinds: Iterable[_Kind]) -> Iterator[str]:
    for thing in things.values():
        if thing.kind == "rig":
            yield f"{thing.name} was left behind: it is an agent, not a thing"
        elif thing.size_m is not None:
            size = " x ".join(f"{edge * 1000:.0f}" for edge in thing.size_m)
            yield f"{thing.name}: its size of {size} mm has no place in VoxML"
    for kind in kinds:
        if kind.things[0].kind != "marker_box" and not kind.things[0].is_surface:
            yield f"{kind.pred}: nothing is known of its shape"


FORMAT = Format(
    name="voxml",
    description="VoxML entries, a file for each kind of object: shape, habitat, what was seen to be done with it",
    part=part,
    options=VoxmlOptions,
)
