"""What there is to say about a session to another program: the layer that is written, and what it needs beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import PurePosixPath

from ecat.errors import EcatError
from ecat.formats.episodes import chosen_layer
from ecat.formats.interchange.facts import labels_of
from ecat.formats.interchange.leftovers import left_behind
from ecat.formats.interchange.times import NOMINAL_HZ, FrameTimes, times_of
from ecat.formats.options import option
from ecat.model import AnnotatedObject, CodingScheme, Event, Layer, Manifest, Segment
from ecat.model.document import span
from ecat.store import Session
from ecat.store.media import annotated_stream
from ecat.store.schemes import find_scheme


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerOptions:
    """What every writer of annotations can be told."""

    layer: str = option("", "the layer; nothing: gold, else main, else the first of a person")
    media: str = option(
        "", "the folder of the media, as the file names it; nothing: that of the session, beside it"
    )
    fps: float = option(
        NOMINAL_HZ, "images a second where the session has no clock", least=0.01, most=100_000
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelOptions(LayerOptions):
    """What writers of shapes can be told, too."""

    width: int | None = option(
        None, "of the images in pixels, where the session does not say", least=1, most=100_000
    )
    height: int | None = option(
        None, "of the images in pixels, where the session does not say", least=1, most=100_000
    )


@dataclass(frozen=True, kw_only=True)
class Source:
    """A layer on its way to another program.

    Parameters
    ----------
    label : what the session is called.
    scheme : the layer's coding scheme, if it is at hand.
    """

    session: Session
    label: str
    options: LayerOptions
    layer: Layer
    times: FrameTimes
    scheme: CodingScheme | None

    @property
    def manifest(self) -> Manifest:
        """The session's."""
        return self.session.manifest

    @property
    def name(self) -> str:
        """The last part of the label."""
        return self.label.rpartition("/")[2]

    @cached_property
    def labels(self) -> dict[str, str]:
        """What the objects are called, by their ids."""
        return labels_of(self.layer.objects)

    @cached_property
    def events(self) -> list[Event]:
        """The events that happen at some time, by their start, wholes before their parts; stretches in order, each of
        one image at least and not before the first.
        """
        timed = [
            replace(
                event,
                segments=tuple(
                    sorted(map(_possible, event.segments), key=lambda s: (s.start_frame, s.end_frame))
                ),
            )
            for event in self.layer.events
            if event.segments
        ]
        return sorted(timed, key=_order)

    @cached_property
    def end(self) -> int:
        """The image after the last: of the recording, or that is annotated."""
        ends = [s.end_frame for event in self.layer.events for s in event.segments]
        ends += [key.frame + 1 for thing in self.layer.objects for key in thing.key_frames]
        return self.manifest.n_frames or max([*ends, 1])

    @property
    def size_px(self) -> tuple[int, int] | None:
        """Width and height of the annotated video, if they are known."""
        options = self.options
        if isinstance(options, PixelOptions) and options.width is not None and options.height is not None:
            return options.width, options.height
        return size_of(self.manifest)

    @cached_property
    def media(self) -> tuple[str, ...]:
        """The videos in colour, the annotated one first, as a file beside the session's folder names them."""
        videos = [stream for stream in self.manifest.streams if stream.kind == "color"]
        names = [(stream.file or stream.name, stream.present) for stream in videos]
        return tuple(self._place(name, inside=present) for name, present in names)

    def _place(self, file: str, *, inside: bool) -> str:
        name = PurePosixPath(file).name
        if self.options.media or not inside:
            return f"{self.options.media.rstrip('/') or '.'}/{name}"
        return f"./{self.name}/{file}"

    def drawn(self, *kinds: str) -> list[AnnotatedObject]:
        """The objects of these kinds that have a shape in the image somewhere."""
        return [
            thing
            for thing in self.layer.objects
            if shape_kind(thing) in kinds and any(key.present for key in thing.key_frames)
        ]

    def findings(self, carries: frozenset[str], program: str, *more: str, own: str = "") -> tuple[str, ...]:
        """What is left behind by a program that ``carries`` only this, and whatever else is to be said; facts of the
        format ``own`` are not.
        """
        others = [record.name for record in self.manifest.layers if record.name != self.layer.name]
        found = list(left_behind(self.layer, carries, program, own))
        changed = [event.id for event in self.layer.events if any(_possible(s) != s for s in event.segments)]
        if changed and "event" in carries:
            found.append(
                f"stretches without length, or before the first image, were made possible: of {listed(changed)}"
            )
        if others:
            names = ", ".join(others)
            found.append(
                f"layer {self.layer.name} was written, not {names}: --option layer=NAME takes another"
            )
        return (*found, *(line for line in more if line))

    def made_up(self) -> str:
        """What to say where times are told, and nobody knows them."""
        if self.times.known:
            return ""
        return f"the session has no clock: times are those of {self.times.nominal_hz:g} images a second (--option fps)"


def size_of(manifest: Manifest) -> tuple[int, int] | None:
    """Width and height of the annotated video in pixels, if they are known."""
    video = annotated_stream(manifest)
    if video is None:
        return None
    if video.width_px and video.height_px:
        return video.width_px, video.height_px
    camera = manifest.camera(video.camera or "color")
    return None if camera is None else (camera.width_px, camera.height_px)


def shape_kind(thing: AnnotatedObject) -> str:
    """``rectangle``, ``polygon`` or ``point``: what the key frames of an object draw."""
    return thing.kind if thing.kind in {"rectangle", "point"} else "polygon"


def source_of(session: Session, label: str, options: LayerOptions) -> Source:
    """What there is to say about a session.

    Raises
    ------
    NotFoundError : there is no such layer, or none at all.
    """
    layer = chosen_layer(session, options.layer)
    return Source(
        session=session,
        label=label,
        options=options,
        layer=layer,
        times=times_of(session, options.fps),
        scheme=scheme_at_hand(session, layer.scheme),
    )


def scheme_at_hand(session: Session, name: str) -> CodingScheme | None:
    """The coding scheme of that name, if the session finds one."""
    if not name:
        return None
    try:
        return find_scheme(session.path, name)
    except EcatError:
        return None


def _possible(segment: Segment) -> Segment:
    """A stretch as other programs can have it; one that was possible as it is."""
    start = max(segment.start_frame, 0)
    end = max(segment.end_frame, start + 1)
    if (start, end) == (segment.start_frame, segment.end_frame):
        return segment
    timed = segment.start_ns is not None and segment.end_ns is not None and segment.start_ns < segment.end_ns
    if timed and start == segment.start_frame:
        return replace(segment, end_frame=end)
    return Segment(start_frame=start, end_frame=end)


def _order(event: Event) -> tuple[int, int, int, str]:
    start, end = span(event) or (0, 0)
    return start, -end, len(event.id), event.id


def counted(n: int, one: str, several: str = "") -> str:
    """``1 role``, ``3 roles``."""
    return f"{n:,} {one if n == 1 else several or one + 's'}"


def listed(names: Sequence[str], most: int = 5) -> str:
    """Some names, and how many more there are."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")
