"""MCAP with Foxglove's well-known schemas: what Foxglove, Rerun and ROS tools open.

Source: https://mcap.dev/spec.  Every message has the time at which it was recorded, in ns; nothing is resampled.

Carried: colour video (packets as recorded where viewers can decode them, otherwise encoded anew), depth and infrared as
they are, calibrations, places of cameras, table and blocks, blocks and bodies as things to see, events and relations
with their roles as ``foxglove.Event``; the annotation XML of every layer, whole, as an attachment.
Left behind: shapes drawn in images, marks and hulls, the uncertainty of poses, sound, inertial readings.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from io import BufferedWriter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ecat.errors import MissingExtraError
from ecat.formats.format import Format
from ecat.formats.options import option
from ecat.formats.robotics import tracks
from ecat.formats.robotics.mcap import said, space
from ecat.formats.robotics.mcap.messages import Item
from ecat.formats.robotics.mcap.streams import Streams
from ecat.formats.robotics.scene import (
    Things,
    clock_shift_ns,
    file_names,
    left_behind,
    required_times,
    table_fits,
    things_of,
)
from ecat.progress import Progress
from ecat.store import Session, files

NAME = "mcap"


@dataclass(frozen=True, slots=True, kw_only=True)
class McapOptions:
    """What is written, and by which clock."""

    times: Literal["session", "wall"] = option(
        "session", "what times count from: the session's start, or 1970 by the recorder's wall clock"
    )
    video: Literal["best", "recorded", "none"] = option(
        "best",
        "colour: packets as recorded, encoded anew where viewers could not decode those; or never anew",
    )
    qp: int = option(20, "step of quantization of what is encoded anew, smaller is better", least=1, most=51)
    depth: bool = option(True, "write depth images")
    infrared: bool = option(False, "write infrared images")
    layer: str = option("", "the only layer whose events and relations are written; nothing: all layers")


class Recorder:
    """Writes messages of any of Foxglove's kinds; a topic gets its channel with its first message."""

    def __init__(self, out: IO[bytes]) -> None:
        from mcap.writer import Writer

        self.writer = Writer(out)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self.writer.start(profile="", library=f"ecat {version('ecat')}")

    def put(self, t_ns: int, topic: str, message: Any) -> None:
        """Append a message."""
        if topic not in self._channels:
            schema = message.get_schema()
            if schema.name not in self._schemas:
                known = self.writer.register_schema(schema.name, schema.encoding, schema.data)
                self._schemas[schema.name] = known
            self._channels[topic] = self.writer.register_channel(
                topic, "protobuf", self._schemas[schema.name]
            )
        self.writer.add_message(self._channels[topic], t_ns, message.encode(), t_ns)


def part(
    session: Session, label: str, dest: Path, options: McapOptions, progress: Progress
) -> tuple[str, ...]:
    """Write a session.

    Raises
    ------
    MissingExtraError : the extra ``mcap`` is not installed.
    NotFoundError : the session has no clock; or the wall clock is asked for and unknown; no such layer.
    CorruptError : a stream cannot be read to its end.
    """
    _require_extra()
    what = f"cannot write {label} as MCAP"
    times = required_times(session, what)
    findings: list[str] = []
    shift_ns = clock_shift_ns(session, options.times, what, findings)
    things = things_of(session)
    with ExitStack() as opened:
        folder = Path(opened.enter_context(TemporaryDirectory(dir=dest.parent)))
        streams = Streams(
            session, folder, shift_ns, options.video, options.depth, options.infrared, options.qp, findings
        )
        sources = [*_said(session, options, things, times, shift_ns)]
        sources += _space(session, things, times, shift_ns, findings)
        sources += streams.sources(opened)
        recorder = Recorder(opened.enter_context(BufferedWriter(files.NewFile(dest))))
        last = int(times[-1]) // 1_000_000_000
        _attach(session, recorder, shift_ns)
        for count, item in enumerate(heapq.merge(*sources, key=lambda item: item[0])):
            recorder.put(*item)
            if count % 256 == 0:
                progress(f"writing {label}", min((item[0] - shift_ns) // 1_000_000_000, last), last)
        recorder.writer.finish()
    carried = ("poses", "poses_smooth", "joints", "table_plane", "table_outline", "camera_poses", "frames")
    findings += left_behind(session, carried, streams=streams.carried)
    return tuple(findings)


def _require_extra() -> None:
    for module in ("foxglove", "mcap"):
        if find_spec(module) is None:
            raise MissingExtraError(
                "cannot write MCAP", where=f"{module} is not installed", fix="pip install 'ecat[mcap]'"
            )


def _said(
    session: Session, options: McapOptions, things: Things, times: NDArray[np.int64], shift_ns: int
) -> Iterator[Iterator[Item]]:
    names = [options.layer] if options.layer else [record.name for record in session.manifest.layers]
    for name, topic in zip(names, file_names(names), strict=True):
        events = said.events(session.layer(name), things, times)
        relations = said.relations(session, name, things, times)
        yield said.messages_of(events, f"/events/{topic}", shift_ns)
        yield said.messages_of(relations, f"/relations/{topic}", shift_ns)


def _space(
    session: Session, things: Things, times: NDArray[np.int64], shift_ns: int, findings: list[str]
) -> Iterator[Iterator[Item]]:
    moving, fits = session.has_table("camera_poses"), table_fits(session)
    yield space.camera_places(session, shift_ns)
    if moving:
        yield space.camera_travels(session, times, shift_ns)
    if fits is not None:
        yield space.table_places(fits, times, shift_ns, moving=moving)
        yield space.table_shapes(session, fits, times, shift_ns)
    table = tracks.best_poses(session)
    if table is None:
        findings.append("no blocks: there are no poses (ecat process computes them)")
    else:
        yield space.blocks(session, table, things, times, shift_ns)
        if unknown := space.sizeless(things, tracks.box_ids(session, table)):
            findings.append(f"the size of {', '.join(unknown)} is not known; only the name is shown there")
    if session.has_table("joints"):
        yield space.skeletons(session, things, times, shift_ns)


def _attach(session: Session, recorder: Recorder, shift_ns: int) -> None:
    """The annotation as it is, and where the file comes from."""
    manifest = session.manifest
    for record in manifest.layers:
        data = files.confined(session.path, record.file).read_bytes()
        recorder.writer.add_attachment(shift_ns, shift_ns, f"{record.name}.xml", "application/xml", data)
    about = {
        "session": manifest.name,
        "clock_start": manifest.clock.start or "",
        "clock_rule": manifest.clock.rule,
        "depth_unit_m": json.dumps({s.name: s.depth_unit_m for s in manifest.streams if s.kind == "depth"}),
    }
    recorder.writer.add_metadata("ecat", about)


FORMAT = Format(
    name=NAME,
    description="MCAP for Foxglove, Rerun and ROS tools: video, depth, blocks, bodies, events, every time as recorded",
    part=part,
    suffix=".mcap",
    options=McapOptions,
)
