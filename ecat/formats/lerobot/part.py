"""One session as a LeRobot data set of its own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ecat.errors import InputError, UsageError
from ecat.formats.episode_plan import Plan
from ecat.formats.episodes import Episode, left_behind
from ecat.formats.lerobot import language, layout
from ecat.formats.lerobot.dataset import DatasetWriter, Facts, Record, write_json
from ecat.formats.lerobot.layout import Layout, View, video_key
from ecat.formats.lerobot.options import LeRobotOptions
from ecat.formats.lerobot.recorded import Camera
from ecat.formats.lerobot.video import LONGEST_S
from ecat.formats.stream_names import plain_name
from ecat.model import Stream
from ecat.progress import Progress
from ecat.stages.resample import filled
from ecat.store import Session, files

MADE = "meta/ecat.json"
"""How a data set was made; LeRobot's readers do not look at it."""


@dataclass
class _Notes:
    """What is told in the end."""

    held: Counter[str] = field(default_factory=Counter[str])
    off_ns: Counter[str] = field(default_factory=Counter[str])
    unheard: int = 0
    long: int = 0


def write_part(
    session: Session, label: str, dest: Path, options: LeRobotOptions, progress: Progress
) -> tuple[str, ...]:
    """Write one session to the folder ``dest``; see :class:`ecat.formats.format.PartWriter`.

    Raises
    ------
    InputError : there is no episode, no clock, or nothing to tell of any moment; or two streams would have one name.
    UsageError : options that name what there is not.
    CorruptError, FormatError : a recording cannot be read.
    """
    require_options(options)
    plan = Plan(session, label, options)
    dropped: list[str] = []
    notes = _Notes()
    streams = list(_streams(plan, options, dropped))
    layout.require_unlike_videos(stream.name for stream in streams)
    with ExitStack() as stack:
        cameras = {
            video_key(stream.name): stack.enter_context(
                Camera(session, stream, dest / f"{plain_name(stream.name)}.scratch.mp4", options)
            )
            for stream in streams
        }
        writer: DatasetWriter | None = None
        files.make_folders(dest)
        for number, episode in enumerate(plan.episodes()):
            progress(label, number, len(plan))
            if writer is None:
                writer = stack.enter_context(
                    DatasetWriter(dest, _layout(episode, cameras, options), private=True)
                )
            writer.add(_record(episode, cameras, options, notes))
        assert writer is not None
        writer.finish({"train": f"0:{len(plan)}"})
    progress(label, len(plan), len(plan))
    write_json(dest / MADE, {"video": _choices(cameras), "worst_offset_s": _seconds(notes.off_ns)})
    return (
        *plan.findings,
        *dropped,
        *_findings(notes, cameras),
        *left_behind(session, plan.layer, "LeRobot", plan.streams),
    )


def _streams(plan: Plan, options: LeRobotOptions, dropped: list[str]) -> Iterator[Stream]:
    """The streams that become videos; why others do not goes into ``dropped``."""
    wanted = tuple(name.strip() for name in options.cameras.split(",") if name.strip())
    if unknown := [name for name in wanted if name not in plan.streams]:
        raise InputError(
            f"cannot export stream {', '.join(unknown)}",
            where=f"the streams of images that are there: {', '.join(plan.streams) or 'none'}",
            fix="cameras= names those wanted",
        )
    for name, stream in plan.streams.items():
        if wanted and name not in wanted:
            continue
        if stream.kind == "infrared":
            dropped.append(f"stream {name}: LeRobot has no place for infrared images of 16 bits")
        elif stream.kind == "depth" and options.depth == "none":
            dropped.append(f"stream {name}: depth=none")
        elif not plan.shows(name):
            dropped.append(f"stream {name}: some episodes have no image of it")
        else:
            yield stream


def _layout(episode: Episode, cameras: Mapping[str, Camera], options: LeRobotOptions) -> Layout:
    if not (episode.state_names or episode.action_names or cameras):
        raise InputError(
            f"cannot export {episode.session}",
            where=f"{episode.session}: there are neither poses nor joints nor videos",
            fix="ecat process places boxes where they were seen",
        )
    return Layout(
        fps=options.fps,
        state=episode.state_names,
        action=episode.action_names,
        views={
            key: View(kind=camera.kind, width=camera.width, height=camera.height)
            for key, camera in cameras.items()
        },
        language=options.language,
    )


def _record(
    episode: Episode, cameras: Mapping[str, Camera], options: LeRobotOptions, notes: _Notes
) -> Record:
    vectors: dict[str, NDArray[Any]] = {
        layout.STATE: filled(episode.state),
        layout.ACTION: filled(episode.action),
        layout.STATE_KNOWN: np.isfinite(episode.state).astype(np.float32),
        layout.ACTION_KNOWN: np.isfinite(episode.action).astype(np.float32),
    }
    clips = {key: camera.clip(_shown(episode, camera, notes), options.fps) for key, camera in cameras.items()}
    notes.unheard += language.unheard(episode)
    notes.long += len(episode) > LONGEST_S * options.fps
    return Record(
        task=episode.task,
        n=len(episode),
        vectors=vectors,
        said=language.entries(episode, options.gaps) if options.language != "none" else (),
        clips=clips,
        facts=Facts(
            session=episode.session,
            event=episode.event,
            performer=episode.performer,
            start_ns=episode.start_ns,
            end_ns=episode.end_ns,
        ),
    )


def _shown(episode: Episode, camera: Camera, notes: _Notes) -> NDArray[np.int64]:
    """Which image is shown at each moment: where none is near, the one before goes on, or the first comes early."""
    name = camera.stream.name
    shown = episode.images[name].astype(float)
    missing = shown < 0
    notes.held[name] += int(missing.sum())
    notes.off_ns[name] = max(notes.off_ns[name], episode.off_ns[name])
    shown[missing] = np.nan
    return filled(shown[:, None])[:, 0].astype(np.int64)


def _choices(cameras: Mapping[str, Camera]) -> dict[str, Any]:
    return {
        key: {
            "episodes_copied": c.copied,
            "episodes_encoded": c.encoded,
            "why": dict(sorted(c.reasons.items())),
        }
        for key, c in cameras.items()
    }


def _seconds(times_ns: Mapping[str, int]) -> dict[str, float]:
    return {name: ns / 1e9 for name, ns in sorted(times_ns.items())}


def _findings(notes: _Notes, cameras: Mapping[str, Camera]) -> Iterator[str]:
    for name, n in sorted(notes.held.items()):
        if n:
            yield f"stream {name}: at {n} moments the image before is shown, none was taken nearer"
    for camera in cameras.values():
        if camera.kind == "color":
            for reason, n in sorted(camera.reasons.items()):
                episodes = "1 episode was" if n == 1 else f"{n} episodes were"
                yield f"stream {camera.stream.name}: {episodes} encoded anew: {reason}"
    if notes.unheard:
        yield f"{notes.unheard} sub-events lie between two moments and are left out"
    if notes.long:
        yield f"{notes.long} episodes last longer than {LONGEST_S} s: lerobot may refuse their last images"


def require_options(options: LeRobotOptions) -> None:
    """Return if the options go together.

    Raises
    ------
    UsageError : they do not.
    """
    _ = options.image_size
    if options.split != "none" and not 0 < options.test_share < 1:
        raise UsageError(
            f"lerobot cannot split by {options.split}",
            where=f"test_share={options.test_share:g}: one of the two would be empty",
            fix="test_share=0.2",
        )
