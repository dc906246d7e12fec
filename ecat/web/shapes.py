"""What answers look like; ``web/openapi.json`` is made from these and from :mod:`ecat.web.asked`."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from ecat.model import CodingScheme, Layer

Json = dict[str, Any]


class Shape(BaseModel):
    """A JSON object without other fields than these."""

    model_config = ConfigDict(extra="forbid")


class ErrorShape(Shape):
    """What could not be done, where the cause is, what happened to the data, what to try."""

    kind: str
    what: str
    where: str
    consequence: str
    fix: str
    problems: str = ""


class Refusal(Shape):
    """Every answer that is no success; ``revision`` and ``records`` come with a conflict."""

    error: ErrorShape
    revision: int | None = None
    records: list[RecordShape] = []


class SessionSummary(Shape):
    """A session in the browser; ``path`` and ``project`` are the ways to its folder and to its project, ``error`` says
    why it cannot be opened.
    """

    id: str
    name: str
    path: str
    project: str
    n_frames: int
    duration_s: float | None
    streams: list[str]
    layers: list[str]
    n_events: int
    n_objects: int
    n_relations: int
    created: str | None
    error: str | None


class ProjectPlace(Shape):
    """A project, by its way from what is served."""

    path: str
    name: str


class ProjectShape(Shape):
    """All sessions; ``author`` and ``layer`` are what ecat annotate was told.

    ``whole`` is false if one session is all that is served: then nothing can be brought in or put away.
    """

    name: str
    root: str
    projects: list[ProjectPlace]
    sessions: list[SessionSummary]
    whole: bool
    author: str
    layer: str


class ProxyShape(Shape):
    """The video to play: image k is shown at ``(k + 0.5) / fps``."""

    state: Literal["absent", "making", "ready", "failed"]
    progress: float | None
    url: str | None
    fps: float | None


class StreamShape(Shape):
    """A recorded stream."""

    name: str
    kind: str
    n_frames: int
    width_px: int | None
    height_px: int | None
    camera: str
    present: bool
    proxy: ProxyShape


class LayerSummary(Shape):
    """A layer; numbers are those of its last checkpoint unless it is being edited here."""

    name: str
    revision: int
    n_events: int
    n_objects: int
    n_relations: int


class Box(Shape):
    """Edge lengths of an object's box along its x, y, z axes."""

    object_id: str
    name: str
    size_m: tuple[float, float, float]


class Body(Shape):
    """Joints of a body in table ``joints``, and the bones between them."""

    body: int
    object_id: str | None
    joints: list[str]
    bones: list[tuple[str, str]]


class CameraShape(Shape):
    """A pinhole camera; ``rotation`` (x, y, z, w) and ``translation_m`` take its points to ``camera/<reference>``."""

    name: str
    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    mirrored: bool
    reference: str
    distortion: list[float]
    rotation: list[float]
    translation_m: list[float]


class Plane(Shape):
    """The table in ``camera/depth``; ``origin`` and ``rotation`` (x, y, z, w) take points of ``table`` there."""

    normal: list[float | None]
    d: float | None
    origin: list[float | None]
    rotation: list[float | None]
    outline: list[list[float | None]]


class SessionShape(Shape):
    """A session; ``video`` is the annotated stream, whose images are the session's frames; ``tables_sha256`` is another
    one as soon as a stage has written a table.
    """

    id: str
    name: str
    n_frames: int
    duration_s: float | None
    clock: str
    video: str | None
    streams: list[StreamShape]
    layers: list[LayerSummary]
    tables: list[str]
    tables_sha256: str
    scheme: CodingScheme
    schemes: list[str]
    frame_rate_median: float | None
    cameras: list[CameraShape]
    bodies: list[Body]
    boxes: list[Box]
    plane: Plane | None
    problems: list[str]


class ChangeShape(Shape):
    """One element before and after (:class:`ecat.model.changes.Change`)."""

    kind: Literal["object", "event", "relation", "decision", "key_frame", "key_frame_3d", "layer"]
    id: str
    index: int
    before: Json | None
    after: Json | None


class RecordShape(BaseModel):
    """A line of the journal."""

    revision: int
    author: str
    time: str
    operation: Json | list[Json]
    changes: list[ChangeShape]


class EditAnswer(Shape):
    """What was recorded."""

    record: RecordShape
    can_undo: bool
    can_redo: bool


class LayerAnswer(Shape):
    """A layer; fields of its elements that have their default are left out."""

    revision: int
    saved_revision: int
    can_undo: bool
    can_redo: bool
    layer: Layer


class HistoryAnswer(Shape):
    """Records in their order; ``revision`` is the layer's."""

    revision: int
    records: list[RecordShape]


class SavedAnswer(Shape):
    """The revision that is in the XML and the tables now."""

    revision: int
    saved_revision: int


class DepthAnswer(Shape):
    """Distance along the optical axis, and the point in the camera's frame, metres."""

    depth_m: float | None
    x: float | None
    y: float | None
    z: float | None


class DepthRange(Shape):
    """The distances that the first and the last colour mean, metres."""

    near_m: float
    far_m: float


class JobShape(Shape):
    """Something that takes a while: at ``step``, ``done`` of ``total`` (0: unknown) are over."""

    id: str
    what: str
    state: Literal["waiting", "running", "done", "failed", "stopped"]
    step: str
    done: int
    total: int
    result: Json | None
    error: Json | None


class UploadShape(Shape):
    """Where files are put."""

    id: str


class Received(Shape):
    """How much of a file came."""

    bytes: int


class Made(Shape):
    """What was made, by the way to it."""

    path: str


class Removed(Shape):
    """Its id in the archive; null if it is gone for good."""

    archived: str | None


class Archived(Shape):
    """A session that was put away, and where it was."""

    id: str
    name: str
    place: str
    when: str


class Restored(Shape):
    """The id of the session that is back."""

    id: str | None


class Neighbour(Shape):
    """Another session of the same folder: ``name`` is what annotations call it by."""

    id: str
    name: str


class OtherObject(Shape):
    """An object of another session, and whether it is drawn there, at all and at its end."""

    id: str
    name: str
    kind: str
    color: str
    drawn: bool
    at_end: bool


class OtherObjects(Shape):
    """What there is in another session, in the layer that copies are made from."""

    session: str
    layer: str
    objects: list[OtherObject]


class DisagreementShape(Shape):
    """One thing that two layers see differently; ``first`` and ``second`` are the ids in them."""

    kind: Literal["object", "event", "relation"]
    first: str | None
    second: str | None
    differs: list[str]
    label: str
    start_frame: int
    end_frame: int


class AgreementShape(Shape):
    """How far two layers agree (``ecat agree``), which objects are the same, and where they do not."""

    layers: list[str]
    revisions: dict[str, int]
    figures: Json
    objects: list[tuple[str, str]]
    disagreements: list[DisagreementShape]


class SurveyAnswered(Shape):
    """What was noted."""

    item: str
    answer: str | int
    comment: str
    time: str


class SurveySummary(Shape):
    """A survey, and how many of its items each person has answered."""

    name: str
    question: str
    items: int
    raters: dict[str, int]


class SurveyItemShape(Shape):
    """A stretch of a session; ``session`` is null if it is not there any more."""

    id: str
    session: str | None
    start_frame: int
    end_frame: int


class SurveyAnswerShape(Shape):
    """What somebody answered before."""

    answer: str | int
    comment: str


class SurveyShape(Shape):
    """What is asked; ``answers`` by item are those of the person who asks for it."""

    name: str
    question: str
    kind: Literal["choice", "score"]
    choices: list[str]
    least: int
    most: int
    items: list[SurveyItemShape]
    answers: dict[str, SurveyAnswerShape]


class SeriesShape(Shape):
    """A curve that can be asked for by its name."""

    name: str
    title: str
    unit: str


class Invitation(Shape):
    """An address below this server's that lets one more browser in, once."""

    path: str


Refusal.model_rebuild()
