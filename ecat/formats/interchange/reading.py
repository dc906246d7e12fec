"""What was found in a file becomes a layer of a session that is there, a new session, or a project of several."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TypeAlias
from urllib.parse import unquote

from ecat.errors import FormatError, LimitError
from ecat.formats.episodes import chosen_layer
from ecat.formats.format import ImportOptions, ImportReport
from ecat.formats.interchange.found import Found
from ecat.formats.interchange.making import layer_of
from ecat.formats.interchange.source import listed, scheme_at_hand, size_of
from ecat.formats.interchange.times import (
    MOST_FRAMES,
    NOMINAL_HZ,
    SECOND_NS,
    clock_of,
    times_of,
    times_of_clock,
)
from ecat.formats.recordings import video
from ecat.model import (
    AnnotatedObject,
    Clock,
    CodingScheme,
    Layer,
    Manifest,
    ProjectManifest,
    Provenance,
    Stream,
)
from ecat.model.scheme import BUILT_IN_SCHEMES
from ecat.progress import Progress
from ecat.store import Draft, Session, create_project, files, fill_session, open_session
from ecat.store.lock import LOCK_FILE
from ecat.store.manifest import is_file_name, is_plain_name
from ecat.store.media import annotated_stream
from ecat.store.schemes import ENDING, write_scheme
from ecat.store.staging import staged_path

Parse: TypeAlias = Callable[[Path], Sequence[Found]]
"""Reads a file: what it says about each recording, at least one."""
MOST_RECORDINGS = 10_000


@dataclass(frozen=True, slots=True)
class Reading:
    """The two ways to read a format, made of one function that parses its files."""

    format_name: str
    parse: Parse

    def read(self, source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
        """Make a session of a file, with the video that lies beside it, or a project if it is about several.

        Raises
        ------
        FormatError, LimitError : the file cannot be read, or the video cannot.
        StoreError : ``dest`` is taken or cannot be written; nothing is left there.
        """
        del options
        recordings = self.parse(source)
        if len(recordings) > MOST_RECORDINGS:
            raise LimitError(
                f"cannot import {source.name}",
                where=f"it is about {len(recordings):,} recordings, at most {MOST_RECORDINGS:,} are imported at once",
                fix="split the file",
            )
        with staged_path(dest) as place:
            if len(recordings) == 1:
                findings = self._make(source, recordings[0], place, dest.resolve().name, progress)
            else:
                findings = self._make_several(source, recordings, place, dest.resolve().name, progress)
        return ImportReport(path=dest, format=self.format_name, sessions=len(recordings), findings=findings)

    def read_layer(self, source: Path, session: Session) -> tuple[Layer, tuple[str, ...]]:
        """Read what a file says about the recording of a session.

        Raises
        ------
        FormatError, LimitError : it cannot be read, or it is about other recordings.
        """
        what = f"cannot import {source.name}"
        found = _about(session, self.parse(source), what)
        followed = scheme_at_hand(session, found.scheme_name)
        if followed is None:
            found = replace(found, scheme_name="")
        layer, findings = _layer(found, session, what, _objects(session))
        unknown = [] if found.scheme is None else _unknown(session, found.scheme)
        if followed is None and unknown:
            findings += (f"types that no coding scheme of the session has: {listed(unknown)}",)
        return layer, findings

    # ---------------------------------------------------------------------------------------- new sessions

    def _make_several(
        self, source: Path, recordings: Sequence[Found], place: Path, name: str, progress: Progress
    ) -> tuple[str, ...]:
        provenance = Provenance(format=self.format_name, source=source.name)
        manifest = ProjectManifest(name=name, created=_now(), provenance=provenance)
        create_project(place, manifest)
        findings: list[str] = []
        taken: set[str] = set()
        for done, found in enumerate(recordings):
            inside = _folder_name(found.name, done, taken)
            progress(inside, done, len(recordings))
            made = self._make(source, found, place / inside, inside, progress)
            findings += [f"{inside}: {line}" for line in made]
        return tuple(findings)

    def _make(
        self, source: Path, found: Found, place: Path, name: str, progress: Progress
    ) -> tuple[str, ...]:
        what = f"cannot import {source.name}"
        name = name if is_plain_name(name) else "session"
        beside, missing = _media_beside(source, found)
        scheme = _scheme_to_write(found, source)
        found = replace(found, scheme_name=scheme.name if scheme is not None else _built_in(found))
        provenance = Provenance(format=self.format_name, source=source.name)
        if beside is None:
            manifest, note = _without_media(found, name)
            times = times_of_clock(manifest.clock, manifest.n_frames, found.rate_hz or NOMINAL_HZ)
            stream = "" if not manifest.streams else manifest.streams[0].name
            layer, findings = layer_of(found, times, what, stream=stream)
            findings += (note,)
            manifest = replace(manifest, provenance=replace(provenance, notes=findings))
            files.make_folder(place)
            fill_session(place, Draft(manifest=manifest, layers=(layer,)), place)
        else:
            report = video.read(beside, place, ImportOptions(), progress)
            session = open_session(place)
            layer, findings = _layer(found, session, what)
            findings = (*report.findings, *findings)
            if missing:
                findings += (f"other media that the file names were not imported: {listed(missing)}",)
            with session.write() as commit:
                commit.put_layer(layer)
                commit.update(name=name, provenance=replace(provenance, notes=findings))
            files.remove(place / LOCK_FILE)
        if scheme is not None:
            write_scheme(scheme, place / "annotations" / f"{scheme.name}{ENDING}")
        return findings


def _layer(
    found: Found, session: Session, what: str, known: Sequence[AnnotatedObject] = ()
) -> tuple[Layer, tuple[str, ...]]:
    """The layer of a session that says what was found."""
    manifest = session.manifest
    video = annotated_stream(manifest)
    return layer_of(
        found,
        times_of(session, found.rate_hz or NOMINAL_HZ),
        what,
        known=known,
        stream="" if video is None else video.name,
        n_frames=manifest.n_frames,
        size_px=size_of(manifest),
    )


def _about(session: Session, recordings: Sequence[Found], what: str) -> Found:
    """What is said about this session: of several recordings, the one of its name or of its video's."""
    if len(recordings) == 1:
        return recordings[0]
    names = {session.name, session.path.resolve().name}
    media = {PurePosixPath(stream.file or stream.name).name for stream in session.manifest.streams}
    mine = [found for found in recordings if found.name in names]
    mine = mine or [found for found in recordings if media & set(map(_name_of, found.media))]
    if len(mine) == 1:
        return mine[0]
    raise FormatError(
        what,
        where=f"it is about {listed([found.name for found in recordings])}, and none of them is {session.name}"
        if not mine
        else f"it is about {session.name} more than once",
        consequence="nothing was written",
        fix="import it to a new folder, which becomes a project of all of them",
    )


def _objects(session: Session) -> list[AnnotatedObject]:
    """The objects of all layers; of the layer that is meant by default first."""
    names = [record.name for record in session.manifest.layers]
    if not names:
        return []
    first = chosen_layer(session).name
    ordered = [first, *(name for name in names if name != first)]
    return [thing for name in ordered for thing in session.layer(name).objects]


def _unknown(session: Session, scheme: CodingScheme) -> list[str]:
    """The types that no coding scheme of the session's layers has."""
    followed = {session.layer(record.name).scheme for record in session.manifest.layers}
    schemes = [found for name in followed if (found := scheme_at_hand(session, name)) is not None]
    known = {kind.name for other in schemes for kind in other.event_types}
    return [kind.name for kind in scheme.event_types if kind.name not in known]


# ---------------------------------------------------------------------------------------------- media and clock


def _media_beside(source: Path, found: Found) -> tuple[Path | None, list[str]]:
    """The first video that the file names and that lies beside it or below, and the others that it names."""
    folder = source.resolve().parent
    for name in found.media:
        for candidate in (unquote(name), _name_of(name)):
            path = folder / PureWindowsPath(candidate).as_posix()
            if _is_video(path) and path.resolve().is_relative_to(folder):
                others = dict.fromkeys(map(_name_of, found.media))
                videos = [n for n in others if n.lower().endswith(video.SUFFIXES)]
                return path, [other for other in videos if other != path.name]
    return None, []


def _is_video(path: Path) -> bool:
    try:
        return video.sniff(path)
    except OSError:  # a name that no file can have
        return False


def _name_of(media: str) -> str:
    """The file that a URL or a path of any system names."""
    return PureWindowsPath(unquote(media.removeprefix("file://"))).name


def _without_media(found: Found, name: str) -> tuple[Manifest, str]:
    """The manifest of a session without media, and how its clock was made."""
    rate, n_frames, why = _clock(found)
    clock = clock_of(n_frames, rate) if rate is not None else Clock(rule="unknown")
    media = _name_of(found.media[0]) if found.media else ""
    width, height = found.size_px or (None, None)
    streams = ()
    if media or found.size_px is not None:
        video = Stream(
            name=media or "color", kind="color", n_frames=n_frames, width_px=width, height_px=height
        )
        streams = (video,)
    manifest = Manifest(name=name, created=_now(), n_frames=n_frames, clock=clock, streams=streams)
    wanted = f"the video {media} does not lie beside the file" if media else "the file names no video"
    return manifest, f"{wanted}; the session has no media, and {why}"


def _clock(found: Found) -> tuple[float | None, int, str]:
    """Images a second if times can be told, how many images there are, and why."""
    last_ns = max(found.last_ns(), found.duration_ns or 0)
    rate = found.rate_hz
    if rate is None and found.n_frames and found.n_frames > 1 and found.duration_ns:
        rate = found.n_frames * SECOND_NS / found.duration_ns
    if rate is None and not last_ns:
        n_frames = found.n_frames or found.last_frame() + 1
        return None, min(n_frames, MOST_FRAMES), "no clock: the file tells images, not times"
    told = rate is not None
    rate = min(max(rate or NOMINAL_HZ, 0.01), 1e5)
    n_frames = found.n_frames or max(found.last_frame() + 1, math.ceil(last_ns * rate / SECOND_NS))
    why = "as the file says" if told else "which the file does not say"
    return rate, min(max(n_frames, 2), MOST_FRAMES), f"a clock of {rate:g} images a second, {why}"


# ---------------------------------------------------------------------------------------------- vocabularies


def _scheme_to_write(found: Found, source: Path) -> CodingScheme | None:
    """The vocabulary of the file as a coding scheme of the new session; none where ecat knows it anyway."""
    if found.scheme is None or _built_in(found):
        return None
    name = found.scheme_name or source.stem
    return replace(
        found.scheme, name=name if is_file_name(name) and name not in BUILT_IN_SCHEMES else "imported"
    )


def _built_in(found: Found) -> str:
    return found.scheme_name if found.scheme_name in BUILT_IN_SCHEMES else ""


def _folder_name(name: str, number: int, taken: set[str]) -> str:
    """A folder for one recording of several."""
    plain = name if is_file_name(name) else f"recording_{number + 1}"
    while plain in taken:
        plain = f"{plain}_{number + 1}"
    taken.add(plain)
    return plain


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
