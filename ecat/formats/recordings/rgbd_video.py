"""A folder of videos, one for each camera: colour of any kind, depth as grey images of 16 bits, and a calibration.

This is what any camera's own programs can be made to write::

    my_recording/
      color.mp4       or color.mkv, rgb.avi, ...: every kind of video that the format ``video`` reads
      depth.mkv       images of 16 bits without loss, for instance FFV1 ``gray16le``; 0 where nothing was measured
      audio.wav       if there is sound
      camera.json     {"color": {"fx": ..., "fy": ..., "cx": ..., "cy": ...}, "depth": {...}, "depth_unit_m": 0.001}

``camera.json`` is described at :func:`ecat.formats.recordings.known_cameras.read_calibration`.  The videos' times count
from a common zero, so a camera that starts late may say so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ecat.errors import FormatError, one_line
from ecat.formats.format import Format, ImportOptions, ImportReport
from ecat.formats.recordings.common import Decoded, Track, copied_track, create, depth_track
from ecat.formats.recordings.known_cameras import read_calibration
from ecat.formats.recordings.video import SUFFIXES, Facts, color_video, video_facts
from ecat.model import Stream
from ecat.progress import Progress
from ecat.store import files
from ecat.store.media import MILLIMETRE
from ecat.store.media.container import scan

NAME = "rgbd-video"
_COLOR, _DEPTH = ("color", "colour", "rgb"), ("depth",)
_SOUND = {".wav": "pcm", ".flac": "flac", ".mp3": "mp3", ".m4a": "aac", ".ogg": "vorbis"}
_WIDE = {"gray16le", "gray16be", "gray14le", "gray12le", "gray10le"}


@dataclass(frozen=True)
class _Folder:
    color: Path | None
    depth: Path | None
    sound: Path | None
    others: tuple[Path, ...]


def _files(folder: Path) -> _Folder:
    names = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    videos = [path for path in names if path.suffix.lower() in SUFFIXES]

    def called(words: tuple[str, ...]) -> Path | None:
        return next((path for path in videos if path.stem.lower() in words), None)

    color, depth = called(_COLOR), called(_DEPTH)
    sound = next(
        (path for path in names if path.suffix.lower() in _SOUND and path.stem.lower() == "audio"), None
    )
    return _Folder(color, depth, sound, tuple(path for path in videos if path not in (color, depth)))


def sniff(path: Path) -> bool:
    """Whether it is a folder with a video called color (rgb) or depth."""
    try:
        found = _files(path) if path.is_dir() else None
    except OSError:
        return False
    return found is not None and (found.color is not None or found.depth is not None)


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Read a folder of videos into a session; the times of each are its own.

    Raises
    ------
    FormatError : there is no such video, none can be read, or the depth has lost its 16 bits.
    LimitError : images of more pixels than ecat reads.
    """
    del options
    what = f"cannot import {source.name}"
    with files.typed_errors(what, source, "nothing was written"):
        found = _files(source)
    lost: list[FormatError] = []
    color, depth = (_facts(path, what, lost) for path in (found.color, found.depth))
    if depth is not None and found.depth is not None:
        _require_16_bits(depth, found.depth, what)
    facts = [one for one in (color, depth) if one is not None]
    if lost and not facts:
        raise lost[0]
    if not facts:
        raise FormatError(
            what,
            where=f"{source}: no video called {' or '.join((*_COLOR, *_DEPTH))}",
            fix="call the colour video color.mp4 and the depth video depth.mkv, or import one video by its own name",
        )
    start_ns = min(one.start_ns for one in facts)
    sizes = [None if one is None else (one.width, one.height) for one in (color, depth)]
    calibration = read_calibration(source, *sizes)
    notes = [*(f"not imported: {error.where}" for error in lost), *calibration.notes]
    if not calibration.cameras:
        notes.append("the cameras are unknown: write camera.json beside the videos to measure in space")
    there = (("colour", found.color), ("depth", found.depth))
    notes += [f"there is no {kind} video" for kind, path in there if path is None]
    tracks: list[Track] = []
    if color is not None and found.color is not None:
        track, odd = color_video(found.color, replace(color, start_ns=start_ns), progress)
        track.stream = replace(track.stream, camera=calibration.camera("color"))
        tracks.append(track)
        notes += odd
    if depth is not None and found.depth is not None:
        tracks.append(
            _depth(found.depth, replace(depth, start_ns=start_ns), calibration.depth_unit_m, progress)
        )
        tracks[-1].stream = replace(tracks[-1].stream, camera=calibration.camera("depth"))
    if found.sound is not None:
        suffix = found.sound.suffix.lower()
        stream = Stream(name="audio", kind="audio", file=f"media/audio{suffix}", codec=_SOUND[suffix])
        tracks.append(copied_track(stream, found.sound))
    notes += [f"{one_line(path.name)} was not imported" for path in found.others]
    return create(
        dest,
        tracks,
        format_name=NAME,
        source=source.resolve().name,
        cameras=calibration.cameras,
        notes=notes,
        start=next((one.created for one in facts if one.created), None),
        progress=progress,
    )


def _facts(path: Path | None, what: str, lost: list[FormatError]) -> Facts | None:
    """What is known of a video; of one that cannot be read, nothing, and why."""
    if path is None:
        return None
    try:
        return video_facts(path, what)
    except FormatError as error:
        lost.append(error)
        return None


def _require_16_bits(facts: Facts, path: Path, what: str) -> None:
    if facts.pix_fmt not in _WIDE:
        raise FormatError(
            what,
            where=f"{path.name}: its images are {facts.pix_fmt}, not grey with 16 bits",
            fix="write depth without loss: ffmpeg -i frames_%05d.png -c:v ffv1 -pix_fmt gray16le depth.mkv",
        )


def _depth(path: Path, facts: Facts, unit_m: float | None, progress: Progress) -> Track:
    """The depth video: copied if it is what ecat would write, else encoded anew, without loss."""
    what = f"cannot import {path.name}"
    found = scan(path, what, tell=lambda done, total: progress(f"reading {path.name}", done, total))
    packets = found.packets[facts.index]
    times = (packets.t_ns - facts.start_ns).tolist()
    images = Decoded(path, facts.index, facts.start_ns, as_depth=True)
    track = depth_track("depth", images, unit_m=unit_m or MILLIMETRE, expected=len(times))
    if unit_m is None:
        track.note("camera.json has no depth_unit_m: its units were taken for millimetres")
    if found.stopped:
        track.note(f"not complete: {found.stopped}; {len(times)} images were there")
    as_is = facts.codec == "ffv1" and facts.pix_fmt == "gray16le" and "matroska" in facts.container
    as_is = as_is and bool(packets.is_key.all())
    if as_is and not found.stopped and not packets.n_unclear and times:
        size = {"width_px": facts.width, "height_px": facts.height, "n_frames": len(times)}
        copied = copied_track(replace(track.stream, **size), path, times)
        copied.notes += track.notes
        return copied
    return track


FORMAT = Format(
    name=NAME,
    description="folder of a colour and a depth video (16-bit), with camera.json: what any camera can be made to write",
    sniff=sniff,
    read=read,
)
