"""A sample session with everything that a recorder would have stored: video, depth, sound, and the clock of each."""

from __future__ import annotations

import wave
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ecat.errors import UsageError
from ecat.geometry.cameras import KINECT_V2_COLOR
from ecat.model import Clock, Layer, Manifest, Stream
from ecat.model.annotation import AnnotatedObject
from ecat.progress import Progress, silent
from ecat.sample.pixels import Renderer
from ecat.sample.pixels.image_truth import Times, image_truth, moments
from ecat.sample.pixels.view import flipped, resized
from ecat.sample.scene import manifest_camera
from ecat.sample.script import ACTIONS
from ecat.sample.session import sample_session
from ecat.sample.truth import GroundTruth
from ecat.store import Draft, TableData
from ecat.store.media import ColorWriter, DepthWriter
from ecat.tables import TABLES

SOUND_HZ = 8000
BEEP_S, BEEP_HZ = 0.08, 1000
_JITTER_NS, _MOST_LATE_NS = 300_000, 15_000_000


@dataclass(frozen=True, eq=False)
class Recording:
    """A session ready to be written, what really happened, and what makes its images at which times."""

    draft: Draft
    truth: GroundTruth
    renderer: Renderer
    times: Times

    def image_truth(self, progress: Progress = silent) -> dict[str, pa.Table]:
        """Tables about every image, for :func:`ecat.sample.write_truth`: see
        :func:`ecat.sample.pixels.image_truth.image_truth`.
        """
        return image_truth(self.renderer, self.times, progress=progress)


def sample_recording(
    *,
    seed: int,
    actions: Sequence[str] = ACTIONS,
    name: str | None = None,
    size: tuple[int, int] | None = None,
    cameras: int = 1,
    mirrored: bool = True,
    depth_size: tuple[int, int] | None = None,
    depth_every: int = 1,
    qp: int = 20,
    progress: Progress = silent,
) -> Recording:
    """A sample session with pixels and without markers: those are to be found.

    What happens is the same as in :func:`ecat.sample.sample_session` with the same seed and actions.  The streams are
    ``color``, with two cameras ``color2``, ``depth`` and ``audio`` with a beep wherever an event begins.  Every camera
    has a clock of its own that starts late and trembles; an image shows the world as it was at its recorded time.

    Parameters
    ----------
    seed, actions, name : see :func:`ecat.sample.sample_session`.
    size : (width, height) of colour images, even numbers; 1920 x 1080 if not given.
    cameras : one or two colour cameras.
    mirrored : whether images are delivered left for right, as by the Kinect.
    depth_size : (width, height) of depth images; 512 x 424 if not given.
    depth_every : how many colour images there are to one of depth.
    qp : step of quantization of the H.264 video; greater is smaller and worse.
    progress : told about every image that is written.

    Raises
    ------
    UsageError : what ``sample_session`` refuses, and impossible sizes or numbers of cameras.
    """
    width, height = size or (KINECT_V2_COLOR.width, KINECT_V2_COLOR.height)
    if width % 2 or height % 2 or min(width, height) < 16 or max(width, height) > 8192:
        where = f"images of {width} x {height} pixels"
        raise UsageError("cannot make a sample session", where=where, fix="give even numbers from 16 to 8192")
    color = resized(KINECT_V2_COLOR, width, height)
    plain, truth = sample_session(
        seed=seed, actions=actions, name=name, color=color if mirrored else flipped(color)
    )
    renderer = Renderer(truth, seed=seed, cameras=cameras, mirrored=mirrored, depth_size=depth_size)
    times = _times(truth, list(renderer.cameras), depth_every)
    manifest = _manifest(plain.manifest, renderer, times)
    draft = Draft(
        manifest=manifest,
        layers=tuple(_retimed(layer, times["color"]) for layer in plain.layers),
        tables={"joints": plain.tables["joints"], "frames": TableData(data=_frames(times))},
        media={
            **{name: _video(renderer, name, times[name], qp, progress) for name in times},
            "audio": lambda path: _write_sound(path, sound(truth)),
        },
    )
    return Recording(draft, truth, renderer, times)


# ------------------------------------------------------------------------------------------------ clocks


def _times(truth: GroundTruth, cameras: Sequence[str], depth_every: int) -> dict[str, NDArray[np.int64]]:
    """When every camera takes its images: whole microseconds, not before the truth begins, nor after it ends."""
    times: dict[str, NDArray[np.int64]] = {}
    for k, name in enumerate(cameras):
        rng = np.random.default_rng([truth.seed, 71, k])
        late = 0 if name == "color" else int(rng.integers(2_000_000, _MOST_LATE_NS))
        shaken = truth.t_ns + late + rng.normal(0, _JITTER_NS, truth.n_frames).astype(np.int64)
        shaken[0] = late
        times[name] = (np.maximum(shaken, 0) // 1000 * 1000)[:: depth_every if name == "depth" else 1]
    return times


def _frames(times: Times) -> pa.Table:
    names = sorted(times)
    t_ns = np.concatenate([times[name] for name in names])
    frame = np.concatenate([np.arange(len(times[name]), dtype=np.int32) for name in names])
    stream = np.repeat(names, [len(times[name]) for name in names])
    order = np.lexsort((stream, t_ns))
    schema = TABLES["frames"].arrow
    columns = [
        pa.array(t_ns[order]),
        pa.array(frame[order]),
        pa.array(stream[order], pa.string()).dictionary_encode().cast(schema.field("stream").type),
    ]
    return pa.Table.from_arrays(columns, schema=schema)


def _retimed(layer: Layer, t_ns: NDArray[np.int64]) -> Layer:
    """The layer with the times of the recorded clock instead of the even one's."""
    # an interval may end after the last image
    whole = [*t_ns.tolist(), 2 * int(t_ns[-1]) - int(t_ns[-2])]

    def at(frame: int | None) -> int | None:
        return None if frame is None else whole[frame]

    def drawn(thing: AnnotatedObject) -> AnnotatedObject:
        return replace(
            thing,
            key_frames=tuple(replace(key, t_ns=at(key.frame)) for key in thing.key_frames),
            key_frames_3d=tuple(replace(key, t_ns=at(key.frame)) for key in thing.key_frames_3d),
        )

    events = tuple(
        replace(
            event,
            segments=tuple(
                replace(s, start_ns=at(s.start_frame), end_ns=at(s.end_frame)) for s in event.segments
            ),
        )
        for event in layer.events
    )
    relations = tuple(replace(r, start_ns=at(r.start_frame), end_ns=at(r.end_frame)) for r in layer.relations)
    return replace(layer, objects=tuple(map(drawn, layer.objects)), events=events, relations=relations)


# ------------------------------------------------------------------------------------------------- media


def _manifest(manifest: Manifest, renderer: Renderer, times: Times) -> Manifest:
    truth = renderer.truth
    streams = [
        Stream(
            name=name,
            kind="depth" if name == "depth" else "color",
            file=f"media/{name}.mkv" if name == "depth" else f"media/{name}.mp4",
            codec="ffv1" if name == "depth" else "h264",
            camera=name,
            n_frames=len(times[name]),
            width_px=camera.width,
            height_px=camera.height,
            depth_unit_m=0.001 if name == "depth" else None,
        )
        for name, camera in renderer.cameras.items()
    ]
    streams.append(Stream(name="audio", kind="audio", file="media/audio.wav", codec="pcm_s16le"))
    return replace(
        manifest,
        clock=Clock(rule="recorded", start=truth.clock.start, duration_ns=int(times["color"][-1])),
        cameras=tuple(
            manifest_camera(camera, "" if name == "depth" else "depth")
            for name, camera in renderer.cameras.items()
        ),
        streams=tuple(streams),
        prototypes=tuple(box.to_dict() for box in truth.prototypes),
        provenance=replace(manifest.provenance, notes=("generated, with images",)),
    )


def _video(
    renderer: Renderer, name: str, t_ns: NDArray[np.int64], qp: int, progress: Progress
) -> Callable[[Path], None]:
    """What writes a camera's file."""
    camera = renderer.cameras[name]
    frames = moments(renderer, t_ns).tolist()

    def write(path: Path) -> None:
        what = f"rendering {name}"
        if name == "depth":
            with DepthWriter(path, camera.width, camera.height) as depth:
                for k, frame in enumerate(frames):
                    progress(what, k, len(frames))
                    depth.write(renderer.depth(frame), int(t_ns[k]))
            return
        with ColorWriter(path, camera.width, camera.height, qp=qp) as color:
            for k, frame in enumerate(frames):
                progress(what, k, len(frames))
                color.write(renderer.color(frame, name), int(t_ns[k]))

    return write


def sound(truth: GroundTruth) -> NDArray[np.int16]:
    """Samples (n,) at ``SOUND_HZ`` of the whole session: silence, and a beep wherever an event begins."""
    made = np.zeros(round((truth.clock.duration_ns or 0) * SOUND_HZ / 1e9) + 1)
    t = np.arange(round(BEEP_S * SOUND_HZ)) / SOUND_HZ
    beep = 0.5 * np.sin(2 * np.pi * BEEP_HZ * t) * np.minimum(1, np.minimum(t, BEEP_S - t) / 0.005)
    for move in truth.moves:
        if move.kind != "set":
            start = round(int(truth.t_ns[move.carries[0].grasp]) * SOUND_HZ / 1e9)
            made[start : start + len(beep)] += beep[: len(made) - start]
    return np.rint(32767 * made).astype(np.int16)


def _write_sound(path: Path, samples: NDArray[np.int16]) -> None:
    with path.open("wb") as raw, wave.open(raw, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(SOUND_HZ)
        file.writeframes(samples.astype("<i2").tobytes())
