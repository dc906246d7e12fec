"""Episodes: stretches of a session on a regular clock, as data sets for learning want them.

A recording is irregular: every stream has a clock of its own, and images come late or not at all.  Whoever learns from
it wants moments at a fixed rate, each with an image of every camera and a vector of numbers.  These are made here
(:mod:`ecat.formats.episode_plan`) and nowhere else; :func:`clock_method` says how, and belongs into whatever is
exported.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ecat.errors import NotFoundError
from ecat.formats.options import option
from ecat.model import Event, Layer, Stream
from ecat.model.annotation import MACHINE
from ecat.store import Session

IMAGE_KINDS = ("color", "depth", "infrared")
_PERFORMER = ("performer", "subject", "person", "participant")


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeOptions:
    """What an episode is, and what it tells; formats for learning inherit these options."""

    episodes: Literal["event", "session"] = option("event", "what becomes one episode")
    fps: int = option(30, "moments a second", least=1, most=1000)
    clock: Literal["nearest", "linear", "images"] = option(
        "nearest",
        "numbers at each moment: of the nearest frame; on a line between two; or each image of the annotated video is "
        "a moment, as if taken at that rate",
    )
    gap_s: float = option(0.25, "what is known only further away in time than this is not known", least=0.0)
    layer: str = option("", "whose annotation; otherwise gold, main, the first person's, or the machine's")
    tier: str = option("", "only events of this tier")
    type: str = option("", "only events of this type")
    state: str = option("boxes,joints,hands", "what the state consists of")
    joints: str = option("", "only these joints, with commas between them")
    poses: Literal["smooth", "raw"] = option("smooth", "poses smoothed in time, where there are such")
    action: Literal["next_pose", "delta", "next_state", "none"] = option(
        "next_pose", "pose of the moved box one moment later; or the way to it; or the next state"
    )
    moved: str = option(
        "Theme", "the role of the box that an event moves; if none has it, the one that moved furthest"
    )


@dataclass(frozen=True, slots=True)
class Subtask:
    """A part of an episode: ``[start_ns, end_ns)`` of the session, and how deep it lies below the episode's event."""

    start_ns: int
    end_ns: int
    text: str
    type: str
    tier: str
    level: int


@dataclass(frozen=True, kw_only=True)
class Episode:
    """A stretch of a session on a regular clock.

    Parameters
    ----------
    session, index : the session's label, and which of its episodes this is. event : its id; empty for a whole session.
    task : the event's text, else its type; type : its type; performer : who acts, empty if that is not known.
    start_ns, end_ns : the stretch, half-open, nanoseconds since the session's start.
    times_ns : (n,) the moments.  Regular, but for the clock ``images``, where they are when images were taken.
    state, action : (n, S) and (n, A) float32, metres and radians in ``table``, NaN where nothing is known; with the
        names of their columns. moved : name of the box that ``action`` is about, empty if there are several or none.
    images : by stream, which image (n,) is shown at each moment: the nearest in time, -1 where there is none.
    subtasks : parts of the event; of a whole session all events, the topmost at level 0.
    off_ns : by stream, how far in time the images are from their moments, at most.
    """

    session: str
    index: int
    event: str = ""
    task: str
    performer: str = ""
    start_ns: int
    end_ns: int
    times_ns: NDArray[np.int64]
    state: NDArray[np.float32]
    state_names: tuple[str, ...]
    action: NDArray[np.float32]
    action_names: tuple[str, ...]
    moved: str = ""
    type: str = ""
    images: Mapping[str, NDArray[np.int64]] = field(default_factory=dict[str, NDArray[np.int64]])
    subtasks: tuple[Subtask, ...] = ()
    off_ns: Mapping[str, int] = field(default_factory=dict[str, int])

    def __len__(self) -> int:
        return len(self.times_ns)


def episodes_of(session: Session, label: str, options: EpisodeOptions) -> Iterator[Episode]:
    """The episodes of a session, in the order of time; one is read at a time.

    Raises
    ------
    InputError : there is no episode in it, or no clock.
    UsageError : options that name what there is not.
    """
    from ecat.formats.episode_plan import Plan

    yield from Plan(session, label, options).episodes()


def clock_method(options: EpisodeOptions) -> dict[str, object]:
    """How the regular clock was made, for the record."""
    return {"method": options.clock, "fps": options.fps, "images": "nearest in time", "gap_s": options.gap_s}


def chosen_layer(session: Session, name: str = "") -> Layer:
    """The layer of this name; without one ``gold``, else ``main``, else the first person's, else the machine's.

    Raises
    ------
    NotFoundError : there is no such layer, or none at all.
    """
    there = [record.name for record in session.manifest.layers]
    what = f"cannot read the annotation of {session.name}"
    if not there:
        raise NotFoundError(
            what,
            where=f"{session.path}: it has no layer",
            consequence="this session was not written",
            fix="ecat annotate, ecat process and ecat import --layer make one",
        )
    usual = [n for n in ("gold", "main") if n in there] + [n for n in there if n != MACHINE] + there
    if name and name not in there:
        raise NotFoundError(
            what,
            where=f"{session.path}: there is no layer {name}; its layers are: {', '.join(there)}",
            consequence="this session was not written",
            fix=f"--option layer=NAME takes one of them; without it, that is {usual[0]}",
        )
    return session.layer(name or usual[0])


def left_behind(session: Session, layer: Layer, program: str, streams: Collection[str]) -> Iterator[str]:
    """What people said or a machine recorded, and moments have no place for, a line each.

    ``streams`` are those that are carried; ``program`` is who reads the moments.
    """
    shapes = sum(len(thing.key_frames) + len(thing.key_frames_3d) for thing in layer.objects)
    counts = {
        "relations": len(layer.relations),
        "links between events": sum(len(event.links) for event in layer.events),
        "roles": sum(len(event.roles) for event in layer.events),
        "shapes drawn by people": shapes,
    }
    if left := [f"{n} {what}" for what, n in counts.items() if n]:
        yield f"{program} has no place for: {', '.join(left)}"
    kinds = {*IMAGE_KINDS, "audio", "imu"}
    kept = [s.name for s in session.manifest.streams if s.present and s.kind in kinds]
    if rest := [name for name in kept if name not in streams]:
        yield f"streams left behind: {', '.join(rest)}"
    others = [r.name for r in session.manifest.layers if r.name not in {layer.name, MACHINE}]
    if others:
        yield f"layer {layer.name} was written, not {', '.join(others)}: --option layer=NAME takes another"


def image_streams(session: Session) -> dict[str, Stream]:
    """The streams of images whose files are there, in the manifest's order."""
    return {s.name: s for s in session.manifest.streams if s.present and s.kind in IMAGE_KINDS}


def performer_of(session: Session, layer: Layer, event: Event | None) -> str:
    """Who acts: what the event, the acting rig or the recording itself says under a name for it; else nothing."""
    said = {p.name.lower(): p.value for p in event.properties} if event else {}
    acting = {role.target.split("/")[0] for role in event.roles} if event else set[str]()
    for thing in layer.objects:
        if thing.kind == "rig" and (not acting or thing.id in acting):
            said = {p.name.lower(): p.value for p in thing.properties} | said
    foreign = {key.rpartition(":")[2].lower(): value for key, value in session.manifest.foreign.items()}
    said = foreign | said
    return next((said[name] for name in _PERFORMER if said.get(name)), "")
