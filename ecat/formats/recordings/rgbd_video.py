"""A folder with a video for each camera: colour of any kind, depth as grey images of 16 bits, and a calibration.

One of the two may be a folder of images instead, ``rgb/`` or ``depth/``.

This is what any camera's own programs can be made to write::

    my_recording/
      color.mp4       or color.mkv, rgb.avi, ...: every kind of video that the format ``video`` reads
      depth.mkv       images of 16 bits without loss, for instance FFV1 ``gray16le``; 0 where nothing was measured
      audio.wav       if there is sound
      camera.json     {"color": {"fx": ..., "fy": ..., "cx": ..., "cy": ...}, "depth": {...}, "depth_unit_m": 0.001}

``camera.json`` is described at :func:`ecat.formats.recordings.known_cameras.read_calibration`.  The videos' times count
from a common zero, so a camera that starts late may say so; those of images are told by a list or by their names
(:func:`ecat.formats.recordings.image_times.times_of`).  What nothing tells stays unknown.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ecat.errors import FormatError, one_line
from ecat.formats.format import Format, ImportOptions, ImportReport
from ecat.formats.recordings.common import Decoded, Image, Track, copied_track, create, depth_track
from ecat.formats.recordings.image_folders import listed, role_folders, usable_sizes
from ecat.formats.recordings.image_times import WORDS, Times, times_of
from ecat.formats.recordings.image_tracks import DISPARITY_UNIT_M, image_track, is_disparity
from ecat.formats.recordings.known_cameras import Calibration, read_calibration
from ecat.formats.recordings.rows import wall_clock
from ecat.formats.recordings.untimed import FILE_PERIOD_NS
from ecat.formats.recordings.video import SUFFIXES, Facts, color_video, video_facts
from ecat.model import Stream
from ecat.progress import Progress
from ecat.store import files
from ecat.store.media import MILLIMETRE
from ecat.store.media.container import scan

NAME = "rgbd-video"
_SAID = {"color": "colour", "depth": "depth"}
_SOUND = {".wav": "pcm", ".flac": "flac", ".mp3": "mp3", ".m4a": "aac", ".ogg": "vorbis"}
_NO_UNIT = "camera.json has no depth_unit_m: its units were taken for millimetres"
_WIDE = {"gray16le", "gray16be", "gray14le", "gray12le", "gray10le"}


@dataclass(frozen=True)
class _Folder:
    """What is in a folder: a video or a folder of images of each kind, sound, and what belongs to neither."""

    path: Path
    videos: dict[str, Path]
    images: dict[str, Path]
    sound: Path | None
    others: tuple[Path, ...]


def _files(folder: Path) -> _Folder:
    names = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    videos = [path for path in names if path.suffix.lower() in SUFFIXES]
    named = {
        kind: found
        for kind, words in WORDS.items()
        if (found := next((path for path in videos if path.stem.lower() in words), None)) is not None
    }
    there = zip(WORDS, role_folders(folder), strict=True)
    images = {kind: path for kind, path in there if path is not None}
    if images.keys() == {"depth"} and len(videos) == 1 and not named:
        # whatever it is called, it is what was recorded beside the depth
        named = {"color": videos[0]}
    sound = next(
        (path for path in names if path.suffix.lower() in _SOUND and path.stem.lower() == "audio"), None
    )
    others = [path for path in videos if path not in named.values()]
    others += [path for kind, path in images.items() if kind in named]
    images = {kind: path for kind, path in images.items() if kind not in named}
    return _Folder(folder, named, images, sound, tuple(others))


def sniff(path: Path) -> bool:
    """Whether it is a folder with a video called color (rgb) or depth, or with one video beside images of depth."""
    try:
        return path.is_dir() and bool(_files(path).videos)
    except OSError:
        return False


@dataclass(frozen=True)
class _Source:
    """What a stream is made of: a video, or images, and their times as far as something beside them tells."""

    kind: str
    size: tuple[int, int]
    video: Path | None = None
    facts: Facts | None = None
    images: Sequence[Path] = ()
    told: Times | None = None

    @property
    def clock(self) -> str:
        """What its times count from: 1970, the start of the recording, or nothing that is known."""
        if self.told is not None:
            return "1970" if self.told.is_wall_clock else "the recording's start"
        return "the recording's start" if self.video is not None else ""

    @property
    def first_ns(self) -> int:
        """When the first image was taken, by that clock."""
        return self.told.t_ns[0] if self.told else self.facts.start_ns if self.facts else 0


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Read a folder of videos, or of a video and images, into a session; the times of each are its own.

    Raises
    ------
    FormatError : there is no such video, none can be read, or the depth has lost its 16 bits.
    LimitError : images of more pixels, or more images, than ecat reads.
    """
    del options
    what = f"cannot import {source.name}"
    with files.typed_errors(what, source, "nothing was written"):
        found = _files(source)
    lost: list[FormatError] = []
    notes: list[str] = []
    made = [_source(found, kind, what, lost, notes) for kind in WORDS]
    sources = [one for one in made if one is not None]
    if lost and not sources:
        raise lost[0]
    if not sources:
        raise FormatError(
            what,
            where=f"{source}: no video called {' or '.join((*WORDS['color'], *WORDS['depth']))}",
            fix="call the colour video color.mp4 and the depth video depth.mkv, or import one video by its own name",
        )
    sizes = {one.kind: one.size for one in sources}
    calibration = read_calibration(source, sizes.get("color"), sizes.get("depth"))
    notes = [*(f"not imported: {error.where}" for error in lost), *calibration.notes, *notes]
    if not calibration.cameras:
        notes.append("the cameras are unknown: write camera.json beside the videos to measure in space")
    there = found.videos.keys() | found.images.keys()
    notes += [f"there is no {said} video" for kind, said in _SAID.items() if kind not in there]
    # the frames of the session are the colour images, so that their clock is the session's
    clock = next((one.clock for one in sources if one.clock), "")
    start_ns = min((one.first_ns for one in sources if one.clock == clock), default=0)
    tracks: list[Track] = []
    for one in sources:
        timed = bool(clock) and one.clock == clock
        at = start_ns if timed else one.first_ns
        track = _track(one, at, calibration, what, progress=progress, notes=notes)
        track.stream = replace(track.stream, camera=calibration.camera(one.kind))
        track.timed = timed
        tracks.append(track)
    notes += _untold(sources, tracks, clock)
    if found.sound is not None:
        suffix = found.sound.suffix.lower()
        stream = Stream(name="audio", kind="audio", file=f"media/audio{suffix}", codec=_SOUND[suffix])
        tracks.append(copied_track(stream, found.sound))
    notes += [f"{one_line(path.name)} was not imported" for path in found.others]
    created = next((one.facts.created for one in sources if one.facts and one.facts.created), None)
    return create(
        dest,
        tracks,
        format_name=NAME,
        source=source.resolve().name,
        cameras=calibration.cameras,
        notes=notes,
        start=wall_clock(start_ns) if clock == "1970" else created,
        progress=progress,
    )


def _source(
    found: _Folder, kind: str, what: str, lost: list[FormatError], notes: list[str]
) -> _Source | None:
    """What there is of a kind; of what cannot be read, nothing, and why."""
    if kind in found.videos:
        path = found.videos[kind]
        facts = _facts(path, what, lost)
        if facts is None:
            return None
        if kind == "depth":
            _require_16_bits(facts, path, what)

        def count() -> int:
            return len(scan(path, what).packets[facts.index].t_ns)

        told = times_of(found.path, kind, count, what, notes)
        return _Source(kind, (facts.width, facts.height), path, facts, told=told)
    if kind not in found.images:
        return None
    images = listed(found.images[kind], what)
    sizes = usable_sizes(images, what, notes, deep=kind == "depth")
    if not sizes:
        lost.append(
            FormatError(what, where=f"{found.images[kind].name}: there is no image in it that can be read")
        )
        return None
    size = Counter(sizes.values()).most_common(1)[0][0]
    usable = [path for path in images if sizes.get(path) == size]
    if others := len(sizes) - len(usable):
        notes.append(
            f"{others} {_SAID[kind]} images of another size than {size[0]} x {size[1]} were left out"
        )
    return _Source(kind, size, images=usable, told=times_of(found.path, kind, usable, what, notes))


def _untold(sources: Sequence[_Source], tracks: Sequence[Track], clock: str) -> Iterator[str]:
    """What is not known of the times."""
    for one, track in zip(sources, tracks, strict=True):
        if track.timed:
            continue
        missed = f"{one.kind}_timestamps.txt with a time for each would tell"
        if one.clock:
            by = f" ({one.told.told_by})" if one.told else ""
            both = " and ".join(f"{source.kind}_timestamps.txt" for source in sources)
            missed = f"its times{by} count from {one.clock} and the others from {clock}; {both} by one clock would tell"
        yield f"stream {one.kind}: it is not known when its images were taken: {missed}"
    n = {track.stream.name: len(track.t_ns) or track.expected for track in tracks}
    if len(set(n.values())) > 1 and not all(track.timed for track in tracks):
        counts = " and ".join(f"{number} {_SAID[kind]} images" for kind, number in n.items())
        yield f"there are {counts}: which belong together is not known, and they are taken to be spread evenly"


def _track(
    one: _Source,
    start_ns: int,
    calibration: Calibration,
    what: str,
    *,
    progress: Progress,
    notes: list[str],
) -> Track:
    """The stream, its times from ``start_ns`` on."""
    t_ns = [t - start_ns for t in one.told.t_ns] if one.told else []
    if one.video is None or one.facts is None:
        return _of_images(one, t_ns, calibration, what)
    facts = one.facts if one.told else replace(one.facts, start_ns=start_ns)
    if one.kind == "color":
        track, odd = color_video(one.video, facts, progress)
        notes += odd
    else:
        track = _depth(one.video, facts, calibration.depth_unit_m, progress)
    if t_ns and isinstance(track.images, Decoded):
        own = scan(one.video, what).packets[facts.index].t_ns - facts.start_ns
        decoded = track.images
        track.images = _Retimed(
            decoded.path, decoded.index, decoded.start_ns, decoded.as_depth, own_ns=own.tolist(), told_ns=t_ns
        )
    elif t_ns:
        track.t_ns = array("q", t_ns)
    return track


@dataclass
class _Retimed(Decoded):
    """Images whose times a list tells: those that the file has are ``own_ns``, in the same order."""

    own_ns: list[int] = field(default_factory=list[int])
    told_ns: list[int] = field(default_factory=list[int])

    def __call__(self) -> Iterator[tuple[int, Image]]:
        for t_ns, image in super().__call__():
            yield self.told_ns[min(bisect_left(self.own_ns, t_ns), len(self.told_ns) - 1)], image


def _of_images(one: _Source, t_ns: list[int], calibration: Calibration, what: str) -> Track:
    paths = one.told.paths if one.told else one.images
    disparity = one.kind == "depth" and is_disparity(paths[0], what)
    unit_m = DISPARITY_UNIT_M if disparity else calibration.depth_unit_m
    track = image_track(
        one.kind,
        paths,
        t_ns or [i * FILE_PERIOD_NS for i in range(len(paths))],
        what,
        unit_m=(unit_m or MILLIMETRE) if one.kind == "depth" else None,
        disparity=disparity,
    )
    if one.kind == "depth" and unit_m is None:
        track.note(_NO_UNIT)
    return track


def _facts(path: Path, what: str, lost: list[FormatError]) -> Facts | None:
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
        track.note(_NO_UNIT)
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
    description="folder of a colour and a depth video (16-bit), or one of them and images, with camera.json: what any "
    "camera can be made to write",
    sniff=sniff,
    read=read,
)
