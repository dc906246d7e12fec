"""Plain video of any origin: what PyAV (FFmpeg) reads, with the times its images carry."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ecat.errors import FormatError
from ecat.formats.format import Format, ImportOptions, ImportReport
from ecat.formats.recordings.common import Decoded, Track, color_track, copied_track, create
from ecat.model import Stream
from ecat.progress import Progress
from ecat.store.media import remux
from ecat.store.media.container import Packets, Scan, decoded, first_video, open_media, scan

if TYPE_CHECKING:
    from av.container import InputContainer

NAME = "video"
SUFFIXES = (
    *(".mp4", ".m4v", ".mov", ".3gp", ".3g2", ".avi", ".mkv", ".webm", ".ogv", ".mpg", ".mpeg"),
    *(".ts", ".mts", ".m2ts", ".wmv", ".flv", ".dv", ".mxf"),
)
_PLAYABLE = {"h264": {"yuv420p", "yuvj420p"}, "vp9": {"yuv420p"}, "av1": {"yuv420p", "yuv420p10le"}}
"""Codecs that browsers play, with the pixel formats that they all know."""
_PLAYABLE_FILES = {".mp4": "mp4", ".m4v": "mp4", ".webm": "webm", ".mkv": "matroska"}
_RATE_TOLERANCE = 0.02


@dataclass(frozen=True)
class Facts:
    """What is known of a video before any of it is decoded."""

    index: int
    codec: str
    pix_fmt: str
    width: int
    height: int
    declared_hz: Fraction | None
    start_ns: int
    audio: tuple[tuple[int, str], ...]
    others: int
    created: str | None
    software: str
    container: str


def sniff(path: Path) -> bool:
    """Whether the file is named as videos are."""
    return path.suffix.lower() in SUFFIXES and path.is_file()


def color_video(source: Path, facts: Facts, progress: Progress) -> tuple[Track, list[str]]:
    """The video as a track called color, its times from ``facts.start_ns`` on, and what is odd about it."""
    what = f"cannot import {source.name}"
    found = scan(source, what, tell=lambda done, total: progress(f"reading {source.name}", done, total))
    packets = found.packets[facts.index]
    if not len(packets.pts) and not packets.n_unclear:
        raise FormatError(what, where=found.stopped or f"{source.name}: there is not a single image in it")
    turned = next((frame.rotation for frame in decoded(source, what, facts.index)), 0)
    notes = [*_notes(facts, packets, found), *([_turned(turned)] if turned else [])]
    return _color(source, facts, packets, found), notes


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Read a video into a session; its times are those in the file, from the start of the first of its streams.

    Raises
    ------
    FormatError : not a video, or not one image can be decoded.
    LimitError : images of more pixels than ecat reads.
    """
    del options
    what = f"cannot import {source.name}"
    facts = video_facts(source, what)
    track, notes = color_video(source, facts, progress)
    return create(
        dest,
        [track, *_audio(source, facts, track)],
        format_name=NAME,
        source=source.name,
        notes=notes,
        start=facts.created,
        software=facts.software,
        progress=progress,
    )


def video_facts(source: Path, what: str) -> Facts:
    """What is known of a video before any of it is decoded.

    Raises
    ------
    FormatError, LimitError : it is no video that can be read.
    """
    index = first_video(source, what)
    with open_media(source, what) as container:
        return _facts(container, index)


def _facts(container: InputContainer, index: int) -> Facts:
    stream = next(s for s in container.streams.video if s.index == index)
    context = stream.codec_context
    created = container.metadata.get("creation_time")
    return Facts(
        index=index,
        codec=context.name.removeprefix("lib").removesuffix("-av1").replace("dav1d", "av1"),
        pix_fmt=str(context.pix_fmt),
        width=context.width,
        height=context.height,
        declared_hz=stream.average_rate,
        start_ns=(container.start_time or 0) * 1000,
        audio=tuple(
            (s.index, s.codec_context.name) for s in container.streams.audio if _is_known(s.codec_context)
        ),
        others=len(container.streams.video) - 1,
        created=created.replace("Z", "+00:00") if created else None,
        software=container.metadata.get("encoder", ""),
        container=container.format.name,
    )


def _is_known(context: object) -> bool:
    return context is not None


def _color(source: Path, facts: Facts, packets: Packets, found: Scan) -> Track:
    """The video as a track: the file itself, its packets in another container, or encoded anew."""
    playable = facts.pix_fmt in _PLAYABLE.get(facts.codec, ()) and not packets.n_unclear
    suffix = source.suffix.lower()
    times = (packets.t_ns - facts.start_ns).tolist()
    if not playable or not packets.is_key.any() or (np.diff(packets.shown_pts) == 0).any():
        track = color_track("color", Decoded(source, facts.index, facts.start_ns), expected=len(times))
        track.note(f"transcoded from {facts.codec} {facts.pix_fmt} to H.264, which browsers play")
        return track
    as_is = not found.stopped and _PLAYABLE_FILES.get(suffix, "?") in facts.container
    suffix = suffix if as_is else ".mp4"
    stream = Stream(
        name="color",
        kind="color",
        file=f"media/color{suffix}",
        codec=facts.codec,
        n_frames=len(times),
        width_px=facts.width,
        height_px=facts.height,
    )
    if as_is:
        return copied_track(stream, source, times)
    track = Track(stream, copy=lambda path: _copy(source, path, facts.index), t_ns=array("q", times))
    track.note(f"taken over undecoded from {facts.container} into MP4")
    return track


def _copy(source: Path, path: Path, index: int) -> None:
    remux(source, path, (index,))


def _audio(source: Path, facts: Facts, color: Track) -> Iterator[Track]:
    """Sound, as it is: in the copied file, or in a file of its own."""
    for number, (index, codec) in enumerate(facts.audio, start=1):
        name = "audio" if number == 1 else f"audio_{number}"
        if color.source is not None:
            yield copied_track(Stream(name=name, kind="audio", file=color.stream.file, codec=codec), source)
        else:
            stream = Stream(name=name, kind="audio", file=f"media/{name}.mka", codec=codec)
            yield Track(stream, copy=lambda path, index=index: _copy(source, path, index))


def _notes(facts: Facts, packets: Packets, found: Scan) -> Iterator[str]:
    if found.stopped:
        yield f"the video is not complete: {found.stopped}; {len(packets.pts)} images were there"
    times = packets.t_ns
    if len(times) > 2 and times[-1] > times[0] and facts.declared_hz:
        real = (len(times) - 1) * 1e9 / float(times[-1] - times[0])
        if abs(real / float(facts.declared_hz) - 1) > _RATE_TOLERANCE:
            yield (
                f"the file declares {float(facts.declared_hz):.4g} images a second, by their times there are "
                f"{real:.4g}; the times count"
            )
    if facts.others:
        yield f"{facts.others} further video streams were not imported"


def _turned(degrees: int) -> str:
    return f"the file asks players to turn its images by {degrees} degrees; the session has them as they are stored"


FORMAT = Format(
    name=NAME,
    description="video of any kind (mp4, mov, avi, mkv, webm, ...), with the times of its images, and its sound",
    sniff=sniff,
    read=read,
)
