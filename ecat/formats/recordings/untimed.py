"""A session of images in their order, whose times nobody recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from ecat.formats.format import ImportReport
from ecat.formats.recordings.common import Track
from ecat.model import Camera, Clock, Manifest, Provenance
from ecat.progress import Progress, silent
from ecat.store import Draft, TableData, create_session
from ecat.store.manifest import is_plain_name
from ecat.store.media import annotated_stream

FILE_PERIOD_NS = 33_333_000
"""Images follow one another by this in the media files, which need times; the session's clock says unknown."""


def create_untimed(
    dest: Path,
    tracks: Sequence[Track],
    *,
    format_name: str,
    source: str,
    n_frames: int = 0,
    cameras: Sequence[Camera] = (),
    tables: Mapping[str, TableData] | None = None,
    notes: Sequence[str] = (),
    progress: Progress = silent,
) -> ImportReport:
    """Write a session of these tracks, image by image in the same order, without a clock.

    Parameters
    ----------
    source : the recording's own name. n_frames : of a session without images.

    Raises
    ------
    FormatError : a stream has not one readable image.
    StoreError : ``dest`` is taken or cannot be written; nothing is left there.
    """
    for track in tracks:
        track.progress = progress

    def finish(manifest: Manifest) -> Manifest:
        streams = tuple(
            replace(
                stream,
                n_frames=len(track.t_ns),
                width_px=track.stream.width_px,
                height_px=track.stream.height_px,
            )
            for stream, track in zip(manifest.streams, tracks, strict=True)
        )
        video = annotated_stream(replace(manifest, streams=streams))
        all_notes = (*notes, *(note for track in tracks for note in track.notes))
        return replace(
            manifest,
            streams=streams,
            n_frames=(video.n_frames or 0) if video is not None else n_frames,
            provenance=replace(manifest.provenance, notes=all_notes),
        )

    name = dest.resolve().name
    manifest = Manifest(
        name=name if is_plain_name(name) else "session",
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        clock=Clock(rule="unknown"),
        cameras=tuple(cameras),
        streams=tuple(track.stream for track in tracks),
        provenance=Provenance(format=format_name, source=source),
    )
    media = {track.stream.name: track.write for track in tracks}
    # an image that cannot be read takes its partner in the next stream along
    draft = Draft(manifest=manifest, tables=tables or {}, media=media, in_order=True, finish=finish)
    session = create_session(dest, draft)
    return ImportReport(path=dest, format=format_name, sessions=1, findings=session.manifest.provenance.notes)
