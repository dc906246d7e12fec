"""Trajectories as the TUM RGB-D benchmark has them: a text file per block, ``t tx ty tz qx qy qz qw`` a line.

Source: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats; ``evo`` and most SLAM tools read it.  Times are
seconds with nine decimals, of the frames as recorded; places are metres in ``table``, of a moving camera in ``world``.

Carried: where every block and camera was whenever that is known.  Left behind: size and name (it is the file's), which
poses were interpolated, their uncertainty, and everything that is no pose.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ecat.errors import NotFoundError
from ecat.formats.format import Format
from ecat.formats.options import option
from ecat.formats.robotics import tracks
from ecat.formats.robotics.scene import clock_shift_ns, file_names, required_times, things_of
from ecat.progress import Progress
from ecat.store import Session, files

_HEAD = "# {what}\n# timestamp tx ty tz qx qy qz qw\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class TumOptions:
    """Which poses, and by which clock."""

    times: Literal["session", "wall"] = option(
        "session", "what times count from: the session's start, or 1970 by the recorder's wall clock"
    )
    smooth: bool = option(True, "the smoothed poses, where there are any")
    interpolated: bool = option(True, "also poses that were filled in where the block was not seen")


def part(
    session: Session, label: str, dest: Path, options: TumOptions, progress: Progress
) -> tuple[str, ...]:
    """Write a folder with a file for each block, and for each moving camera.

    Raises
    ------
    NotFoundError : the session has no poses, or no clock; or the wall clock is asked for and unknown.
    """
    what = f"cannot write the trajectories of {label}"
    progress(f"writing {label}", 0, 0)
    table = tracks.best_poses(session) if options.smooth else "poses"
    if (table is None or not session.has_table(table)) and not session.has_table("camera_poses"):
        raise NotFoundError(
            what,
            where=f"{session.name}: there are no poses",
            consequence="this session was not written",
            fix=f"ecat process {session.path}",
        )
    times = required_times(session, what)
    findings: list[str] = []
    shift_ns = clock_shift_ns(session, options.times, what, findings)
    files.make_folder(dest)
    if table is not None and session.has_table(table):
        findings += _blocks(session, table, dest, options, times=times, shift_ns=shift_ns)
    if session.has_table("camera_poses"):
        findings += _cameras(session, dest, times, shift_ns)
    return (*findings, "the uncertainty of poses, sizes, events and relations have no place in trajectories")


def _blocks(
    session: Session,
    table: str,
    dest: Path,
    options: TumOptions,
    *,
    times: NDArray[np.int64],
    shift_ns: int,
) -> Iterator[str]:
    ids, things = tracks.box_ids(session, table), things_of(session)
    names = file_names([things[key].name for key in ids])
    missing, filled = np.zeros(len(ids), np.int64), np.zeros(len(ids), np.int64)
    with ExitStack() as opened:
        outs = [_open(opened, dest / f"{name}.txt", f"{name}, frame of reference: table") for name in names]
        for stretch in tracks.poses(session, table, ids):
            t_ns = tracks.when(stretch, times) + shift_ns
            known = stretch.known
            missing += (~known).sum(0)
            filled += (known & ~stretch.observed).sum(0)
            kept = known if options.interpolated else known & stretch.observed
            for k, out in enumerate(outs):
                rows = np.hstack([stretch.centre[:, k], stretch.quaternion[:, k]])[kept[:, k]]
                out.writelines(lines(t_ns[kept[:, k]], rows))
    for k, name in enumerate(names):
        if missing[k]:
            yield f"{name}: {missing[k]:,} frames without a known pose have no line"
        if filled[k]:
            told = "cannot be told from those observed" if options.interpolated else "were left out"
            yield f"{name}: {filled[k]:,} interpolated poses {told}"


def _cameras(session: Session, dest: Path, times: NDArray[np.int64], shift_ns: int) -> Iterator[str]:
    paths = list(tracks.camera_paths(session, times))
    for path, name in zip(paths, file_names([f"camera_{path.name}" for path in paths]), strict=True):
        with ExitStack() as opened:
            out = _open(opened, dest / f"{name}.txt", f"camera {path.name}, frame of reference: world")
            rows = np.hstack([path.place.translation, path.place.quaternion])
            out.writelines(lines(path.t_ns + shift_ns, rows))
        if path.n_unknown:
            yield f"camera {path.name}: {path.n_unknown:,} unknown poses have no line"


def _open(opened: ExitStack, path: Path, what: str) -> TextIOWrapper:
    out = opened.enter_context(tracks.new_text(path))
    out.write(_HEAD.format(what=what))
    return out


def lines(t_ns: NDArray[np.int64], rows: NDArray[np.float64]) -> Iterator[str]:
    """Lines with times to the nanosecond, and numbers with as many digits as tell them apart."""
    for t, row in zip(t_ns.tolist(), rows.tolist(), strict=True):
        yield f"{t // 1_000_000_000}.{t % 1_000_000_000:09d} {' '.join(map(repr, row))}\n"


FORMAT = Format(
    name="tum-trajectories",
    description="trajectories of the TUM RGB-D benchmark: a text file per block, t tx ty tz qx qy qz qw",
    part=part,
    options=TumOptions,
)
