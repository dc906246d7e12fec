"""Azure Kinect and Orbbec Femto recordings: Matroska with colour, depth, infrared, IMU and calibration.

Source: learn.microsoft.com, Azure Kinect DK, "record file format"; Azure Kinect Sensor SDK 1.4, calibration by mode.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import FormatError
from ecat.formats.format import Format, ImportOptions, ImportReport
from ecat.formats.recordings.common import Decoded, Track, color_track, create, depth_track
from ecat.formats.recordings.k4a_calibration import cameras_of
from ecat.model import Camera
from ecat.progress import Progress
from ecat.store import TableData
from ecat.store.media.container import Packets, Scan, open_media, scan
from ecat.tables import IMU

if TYPE_CHECKING:
    from av import Packet
    from av.container import InputContainer

NAME = "azure-mkv"
_SNIFFED_BYTES = 1 << 20
_TRACKS = {"COLOR": "color", "DEPTH": "depth", "IR": "infrared", "IMU": "imu"}
_TAGS = ("K4A_DEPTH_DELAY_NS", "K4A_WIRED_SYNC_MODE", "K4A_DEVICE_SERIAL_NUMBER", "K4A_START_OFFSET_NS")
_TRACK_TAGS = {
    "color": "K4A_COLOR_MODE",
    "depth": "K4A_DEPTH_MODE",
    "infrared": "K4A_IR_MODE",
    "imu": "K4A_IMU_MODE",
}
_MAX_CALIBRATION_BYTES = 1 << 20
_BATCH = 1 << 16
SAMPLE = np.dtype([("accel_ns", "<u8"), ("accel", "<f4", 3), ("gyro_ns", "<u8"), ("gyro", "<f4", 3)])
"""One IMU sample: two device times in ns, m/s^2 and rad/s."""


def sniff(path: Path) -> bool:
    """Whether the file is Matroska with the SDK's track names or tags in its head."""
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            head = file.read(_SNIFFED_BYTES)
    except OSError:
        return False
    return head.startswith(b"\x1a\x45\xdf\xa3") and (b"K4A_" in head or b"b16g" in head)


@dataclass
class _Contents:
    """What a recording holds, before any of it is decoded."""

    tags: dict[str, str]
    tracks: dict[str, int] = field(default_factory=dict[str, int])
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict[str, tuple[int, int]])
    codecs: dict[str, str] = field(default_factory=dict[str, str])
    calibration: bytes | None = None


def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
    """Read a recording into a session; ``t_ns`` counts from ``K4A_START_OFFSET_NS``, the start by the device's clock.

    What a damaged or truncated file still holds is imported, and the findings say what is missing.

    Raises
    ------
    FormatError : not such a recording, or nothing in it can be decoded.
    LimitError : images of more pixels than ecat reads.
    """
    del options
    what = f"cannot import {source.name}"
    with open_media(source, what) as container:
        contents = _contents(container)
    if not {"color", "depth", "infrared"} & contents.tracks.keys():
        raise FormatError(what, where=f"{source.name}: there is neither a colour nor a depth track in it")
    samples = bytearray()
    found = scan(
        source,
        what,
        each=_imu_reader(contents.tracks.get("imu"), samples),
        tell=lambda done, total: progress(f"reading {source.name}", done, total),
    )
    notes = list(_notes(source, contents, found))
    cameras, problems = _cameras(contents)
    tracks = list(_tracks(source, contents, found, cameras))
    if not tracks:
        raise FormatError(what, where=found.stopped or f"{source.name}: there is not a single image in it")
    imu = np.frombuffer(bytes(samples[: len(samples) // SAMPLE.itemsize * SAMPLE.itemsize]), SAMPLE)
    offset = _number(contents.tags.get("K4A_START_OFFSET_NS"))
    return create(
        dest,
        tracks,
        format_name=NAME,
        source=source.name,
        cameras=cameras,
        tables={"imu": TableData(data=imu_rows(imu, offset))} if len(imu) else {},
        notes=[*notes, *problems],
        start=_wall_clock(contents.tags.get("creation_time")),
        software=contents.tags.get("encoder", ""),
        foreign={f"{NAME}:{key}": value for key, value in contents.tags.items() if key.startswith("K4A_")},
        progress=progress,
    )


def _contents(container: InputContainer) -> _Contents:
    contents = _Contents(dict(container.metadata))
    for stream in container.streams:
        tags = stream.metadata
        for key, name in _TRACKS.items():
            if name not in contents.tracks and (f"K4A_{key}_TRACK" in tags or tags.get("title") == key):
                contents.tracks[name] = stream.index
        contents.tags |= {key: value for key, value in tags.items() if key.endswith("_MODE")}
        is_file = stream.type == "attachment"
        if is_file and ("K4A_CALIBRATION_FILE" in tags or tags.get("filename") == "calibration.json"):
            contents.calibration = bytes(stream.data or b"")  # pyright: ignore[reportAttributeAccessIssue]
    for stream in container.streams.video:
        context: Any = stream.codec_context
        if context is None:  # a codec that is not known
            continue
        for name, index in contents.tracks.items():
            if index == stream.index:
                contents.sizes[name] = (context.width, context.height)
                contents.codecs[name] = context.name if context.name != "rawvideo" else str(context.pix_fmt)
    contents.tracks = {k: v for k, v in contents.tracks.items() if k == "imu" or k in contents.sizes}
    return contents


def _tracks(source: Path, contents: _Contents, found: Scan, cameras: tuple[Camera, ...]) -> Iterator[Track]:
    known = {camera.name for camera in cameras}
    for name in ("color", "depth", "infrared"):
        index = contents.tracks.get(name)
        packets: Packets | None = found.packets.get(index) if index is not None else None
        if index is None or packets is None or not len(packets.pts):
            continue
        n = len(packets.pts)
        if name == "color":
            camera = "color" if "color" in known else ""
            track = color_track(name, Decoded(source, index), camera=camera, expected=n)
            track.note(f"transcoded from {contents.codecs[name]} to H.264, which browsers play")
        else:
            track = depth_track(
                name,
                Decoded(source, index, as_depth=True),
                unit_m=0.001 if name == "depth" else None,
                camera="depth" if "depth" in known else "",
                expected=n,
                kind="depth" if name == "depth" else "infrared",
            )
        yield track


def _cameras(contents: _Contents) -> tuple[tuple[Camera, ...], list[str]]:
    if contents.calibration is None:
        return (), ["there is no calibration in the recording: the cameras are unknown"]
    if len(contents.calibration) > _MAX_CALIBRATION_BYTES:
        size = f"{len(contents.calibration):,} bytes, more than {_MAX_CALIBRATION_BYTES:,}"
        return (), [f"the calibration is too large to be one ({size}): the cameras are unknown"]
    try:
        document = json.loads(contents.calibration.rstrip(b"\0").decode("utf-8", "replace"))
    except (ValueError, RecursionError) as error:
        return (), [f"the calibration is not JSON ({error}): the cameras are unknown"]
    depth = contents.sizes.get("depth") or contents.sizes.get("infrared")
    return cameras_of(document, color_px=contents.sizes.get("color"), depth_px=depth)


def _notes(source: Path, contents: _Contents, found: Scan) -> Iterator[str]:
    if found.stopped:
        read = ", ".join(
            f"{len(found.packets[i].pts)} of {name}"
            for name, i in contents.tracks.items()
            if i in found.packets
        )
        yield f"the recording is not complete: {found.stopped}; images that were imported: {read or 'none'}"
    expected = (*_TAGS, *(tag for name, tag in _TRACK_TAGS.items() if name in contents.tracks))
    missing = [tag for tag in expected if tag not in contents.tags]
    if missing:
        yield f"{source.name} lacks the tags {', '.join(missing)}"
    for name in ("color", "depth"):
        if name not in contents.tracks:
            yield f"there is no {name} track in the recording"


def _imu_reader(index: int | None, samples: bytearray) -> Any:
    def each(packet: Packet[Any]) -> None:
        if packet.stream_index == index:
            data = bytes(packet)
            samples.extend(data[: len(data) // SAMPLE.itemsize * SAMPLE.itemsize])

    return each if index is not None else None


def imu_rows(samples: NDArray[Any], offset_ns: int) -> Iterator[pa.RecordBatch]:
    """Rows of the table ``imu`` of samples (n,) of type :data:`SAMPLE`, with device times counted from ``offset_ns``.

    Times that 63 bits cannot hold come of damage, and their samples are left out.
    """
    times = np.concatenate([samples["accel_ns"], samples["gyro_ns"]])
    which = np.repeat(np.array([0, 1], np.int32), len(samples))
    sane = times < np.uint64(1 << 62)
    t_ns = np.where(sane, times, 0).astype(np.int64) - offset_ns
    order = np.lexsort((which, t_ns))
    order = order[sane[order]]
    names = pa.array(["accelerometer", "gyroscope"])
    for start in range(0, len(order), _BATCH):
        rows = order[start : start + _BATCH]
        sensor, of = which[rows], rows % len(samples)
        xyz = np.where(sensor[:, None] == 0, samples["accel"][of], samples["gyro"][of]).astype(float)
        columns = [
            pa.array(t_ns[rows]),
            pa.DictionaryArray.from_arrays(pa.array(sensor, pa.int32()), names),
            *(pa.array(xyz[:, axis], from_pandas=True) for axis in range(3)),
        ]
        yield pa.record_batch(columns, schema=IMU.arrow)


def _number(text: str | None) -> int:
    """A tag's value; 0, the documented default, where it is missing or no number."""
    try:
        value = int(text or "0")
    except ValueError:
        return 0
    return value if abs(value) < 1 << 62 else 0


def _wall_clock(text: str | None) -> str | None:
    """``creation_time``, which FFmpeg gives in UTC with fractions of a second."""
    return text.replace(".000000Z", "+00:00").replace("Z", "+00:00") if text else None


FORMAT = Format(
    name=NAME,
    description="recordings of Azure Kinect and Orbbec Femto (.mkv): colour, depth, infrared, IMU, calibration",
    sniff=sniff,
    read=read,
)
