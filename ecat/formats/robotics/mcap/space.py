"""Where things are: frames of reference, and blocks, bodies and the table to see."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ecat.formats.robotics import tracks
from ecat.formats.robotics.mcap import messages
from ecat.formats.robotics.mcap.messages import TABLE, Item
from ecat.formats.robotics.scene import (
    TableFits,
    Thing,
    Things,
    file_names,
    table_outlines,
)
from ecat.geometry.records import depth_from_camera
from ecat.geometry.transforms import Rigid, known
from ecat.store import Session

DEPTH, WORLD = "camera/depth", "world"


def camera_places(session: Session, t_ns: int) -> Iterator[Item]:
    """Where the cameras are on their common mount, once."""
    for camera in session.manifest.cameras:
        if camera.name != "depth":
            place = depth_from_camera(session.manifest, camera)
            child = f"camera/{camera.name}"
            yield t_ns, f"/tf/{child}", messages.transform(t_ns, DEPTH, child, place)


def table_places(fits: TableFits, times: NDArray[np.int64], shift_ns: int, *, moving: bool) -> Iterator[Item]:
    """The table and the depth camera; the first fit holds from the start.

    A camera that does not move hangs below the table, the root; one that moves carries the table.
    """
    for k, frame in enumerate(fits.frame.tolist()):
        t_ns = (0 if k == 0 else int(times[min(frame, len(times) - 1)])) + shift_ns
        table_from_camera = fits.at(frame)
        if moving:
            yield t_ns, "/tf/table", messages.transform(t_ns, DEPTH, TABLE, table_from_camera.inverse())
        else:
            yield t_ns, "/tf/camera/depth", messages.transform(t_ns, TABLE, DEPTH, table_from_camera)


def camera_travels(session: Session, times: NDArray[np.int64], shift_ns: int) -> Iterator[Item]:
    """Where the depth camera was in ``world``, by the path of the first moving camera."""
    path = next(tracks.camera_paths(session, times), None)
    if path is None:
        return
    record = session.manifest.camera(path.name)
    mount = Rigid.identity() if record is None else depth_from_camera(session.manifest, record).inverse()
    world_from_depth = path.place @ mount
    for k, t_ns in enumerate((path.t_ns + shift_ns).tolist()):
        place = Rigid(world_from_depth.rotation[k], world_from_depth.translation[k])
        yield t_ns, "/tf/camera/depth", messages.transform(t_ns, WORLD, DEPTH, place)


def table_shapes(
    session: Session, fits: TableFits, times: NDArray[np.int64], shift_ns: int
) -> Iterator[Item]:
    """The table's outline, whenever it is known anew."""
    for k, (frame, ring) in enumerate(table_outlines(session, fits)):
        t_ns = (0 if k == 0 else int(times[min(frame, len(times) - 1)])) + shift_ns
        yield t_ns, "/table", messages.table(t_ns, ring)


def blocks(
    session: Session, table: str, things: Things, times: NDArray[np.int64], shift_ns: int
) -> Iterator[Item]:
    """At every frame the place of every block that is known, and the blocks as cubes."""
    ids = tracks.box_ids(session, table)
    known_things = [things[key] for key in ids]
    children = [f"block/{name}" for name in file_names([thing.name for thing in known_things])]
    was = np.zeros(len(ids), np.bool_)
    for stretch in tracks.poses(session, table, ids):
        at = tracks.when(stretch, times)
        there = stretch.known
        turned = Rigid.from_quaternion(stretch.quaternion, stretch.centre)
        for f, t in enumerate((at + shift_ns).tolist()):
            for k in np.flatnonzero(there[f]):
                place = Rigid(turned.rotation[f, k], turned.translation[f, k])
                yield t, f"/tf/{children[k]}", messages.transform(t, TABLE, children[k], place)
            shown = [
                (
                    known_things[k],
                    stretch.centre[f, k],
                    stretch.quaternion[f, k],
                    bool(stretch.observed[f, k]),
                )
                for k in np.flatnonzero(there[f])
            ]
            gone = [known_things[k] for k in np.flatnonzero(was & ~there[f])]
            if shown or gone:
                yield t, "/blocks", messages.blocks(t, shown, gone)
            was = there[f]


def skeletons(session: Session, things: Things, times: NDArray[np.int64], shift_ns: int) -> Iterator[Item]:
    """The bodies of every frame."""
    slots = tracks.body_slots(session)
    people = [things[key] if key else _nobody(slot, things) for slot, key in slots.items()]
    was: NDArray[np.bool_] = np.zeros(len(people), np.bool_)
    for stretch in tracks.bodies(session, list(slots)):
        at = tracks.when(stretch, times)
        there = np.logical_or.reduce(known(stretch.position), axis=-1)
        for f, t in enumerate((at + shift_ns).tolist()):
            shown = [
                (people[b].name, people[b].color, stretch.position[f, b], stretch.state[f, b])
                for b in np.flatnonzero(there[f])
            ]
            gone = [people[b].name for b in np.flatnonzero(was & ~there[f])]
            if shown or gone:
                yield t, "/skeleton", messages.skeletons(t, shown, gone)
            was = there[f]


def _nobody(slot: int, things: Things) -> Thing:
    return things[f"body {slot}"]


def sizeless(things: Things, ids: Sequence[str]) -> list[str]:
    """The names of blocks whose size is not known."""
    return [things[key].name for key in ids if things[key].size_m is None]
