"""What was found in another program's file, before it is known which session it belongs to.

Times may be told in nanoseconds or in images; objects go by their labels.  Both are settled when a layer is made of it
(:mod:`ecat.formats.interchange.making`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ecat.model import AnnotatedObject, CodingScheme, Foreign


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """A stretch told in images from zero, end excluded."""

    start: int
    end: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Times:
    """A stretch told in nanoseconds, end excluded, as exactly as ``within_ns``; a moment has no end.

    ``frames`` are the same as the file tells it in images, for a session that has no clock.
    """

    start_ns: int
    end_ns: int | None
    within_ns: int = 0
    frames: Frames | None = None

    @property
    def last_ns(self) -> int:
        """The end, or the moment."""
        return self.start_ns if self.end_ns is None else self.end_ns


@dataclass(slots=True, kw_only=True)
class FoundEvent:
    """An event.

    Parameters
    ----------
    key : tells it from others in the file; its id, if it can be one.
    said : everything else (:mod:`ecat.formats.interchange.facts`); ``parent``, ``links`` and roles name keys.
    """

    key: str
    type: str = ""
    tier: str = ""
    stretches: list[Times | Frames] = field(default_factory=list[Times | Frames])
    said: dict[str, str] = field(default_factory=dict[str, str])
    foreign: tuple[Foreign, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundShape:
    """A shape at an image or at a time, or the absence from it on."""

    frame: int | None = None
    t_ns: int | None = None
    coordinates: tuple[float, ...] = ()
    present: bool = True
    foreign: tuple[Foreign, ...] = ()


@dataclass(slots=True, kw_only=True)
class FoundObject:
    """An object: its record without shapes, the id being what tells it from others in the file (maybe its name), and
    its shapes.

    ``dense`` shapes were told image by image, and what follows from others is no key frame; coordinates ``per_cent``
    are those of the image.
    """

    record: AnnotatedObject
    shapes: list[FoundShape] = field(default_factory=list[FoundShape])
    dense: bool = False
    per_cent: bool = False


@dataclass(slots=True, kw_only=True)
class Found:
    """What a file says about one recording.

    Parameters
    ----------
    name : of the recording. media : the files that it was annotated on, as the file names them.
    rate_hz, n_frames, duration_ns, size_px : of the video, as far as the file says.
    scheme : its vocabularies; ``scheme_name`` that of a coding scheme of ecat that it says it follows.
    """

    name: str = ""
    media: tuple[str, ...] = ()
    events: list[FoundEvent] = field(default_factory=list[FoundEvent])
    objects: list[FoundObject] = field(default_factory=list[FoundObject])
    rate_hz: float | None = None
    n_frames: int | None = None
    duration_ns: int | None = None
    size_px: tuple[int, int] | None = None
    scheme: CodingScheme | None = None
    scheme_name: str = ""
    findings: list[str] = field(default_factory=list[str])

    def last_frame(self) -> int:
        """The last image that anything is told of in images; -1 if nothing is."""
        said = [s if isinstance(s, Frames) else s.frames for e in self.events for s in e.stretches]
        ends = [s.end - 1 for s in said if s is not None]
        return max([*ends, *(s.frame for o in self.objects for s in o.shapes if s.frame is not None), -1])

    def last_ns(self) -> int:
        """The last time that anything is told of in times; 0 if nothing is."""
        ends = [s.last_ns for e in self.events for s in e.stretches if isinstance(s, Times)]
        return max([*ends, *(s.t_ns for o in self.objects for s in o.shapes if s.t_ns is not None), 0])
