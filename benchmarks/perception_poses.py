"""Block poses from rendered images, against the truth: frame by frame, and smoothed.

    python benchmarks/perception_poses.py [--seeds 901 902] [--frames 90]

Sessions of `ecat.sample.pixels` on seeds that nothing was tuned on: the table as in the recordings (1.1 to 1.6 m), the
camera half a metre further back (1.5 to 2.1 m), and one block carried about and tilted in the air.  Markers are found
by the stage `track`, the table and the faces' planes in depth images that are taken a tenth of a frame later than the
colour images.  Geometry: fitted (measured from 40 images in which both blocks turn where they stand), own (measured
from the very recording, as `ecat process` does, and nominal where that cannot be), nominal (markers where they should
be), exact.
Errors are measured in the depth camera's frame, so that those of the table count.  NEES: squared error over what the
covariance says, per degree of freedom; 1 is right, less is cautious.

The last table is about a camera that is moved in the middle of a recording: by how much blocks that nobody touched
seem to have moved on the table.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

from ecat.errors import InputError
from ecat.geometry.boxfit import SUBPIXEL
from ecat.geometry.cameras import Camera
from ecat.geometry.transforms import (
    Floats,
    Rigid,
    matrix_from_rotvec,
    quaternion_angle,
    quaternion_from_matrix,
)
from ecat.model.prototype import FACES, BoxPrototype, MarkerFace, face_normal
from ecat.sample import ACTIONS, GroundTruth, sample_session
from ecat.sample.pixels import Renderer
from ecat.stages.calibrate import CalibrationParameters, calibrate_boxes, recordings_on
from ecat.stages.face_planes import FacePlaneParameters, fit_face_planes
from ecat.stages.plane import PLANE, PlaneParameters
from ecat.stages.pose import PoseParameters, estimate_poses, table_frame
from ecat.stages.smooth import pose_covariances, smooth_poses
from ecat.stages.table_depth import fit_table_in_depth
from ecat.stages.track import TrackParameters, object_ids, track_markers

KINDS = ("table", "far", "carried")
TURNED = "turned"
"""Both boxes turn where they stand, so that all faces are seen together: what the markers are measured from."""
LATER = 0.1
"""Frames by which depth is taken after colour."""


@dataclass(frozen=True)
class Film:
    """Images in memory, or made when they are asked for."""

    frame: NDArray[np.int64]
    t_ns: NDArray[np.int64]
    camera: Camera
    make: Any
    unit_m: float = 0.001

    def __len__(self) -> int:
        return len(self.frame)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        return self.read(range(len(self)))

    def read(self, indices: Sequence[int]) -> Iterator[NDArray[Any]]:
        """The images with these indices."""
        return (self.make(i) for i in indices)


@dataclass(frozen=True)
class Take:
    """A recording: what was seen of it, and what really happened (boxes, frames)."""

    kind: str
    clock: pa.Table
    color: Camera
    depth: Film
    markers: pa.Table
    plane: pa.Table
    true: Rigid
    prototypes: tuple[BoxPrototype, ...]


def carried(truth: GroundTruth, seed: int) -> GroundTruth:
    """The first box is carried about, up to 30 degrees tilted."""
    rng = np.random.default_rng([seed, 7])
    t = np.arange(truth.n_frames)[:, None] / 30

    def wave(size: Sequence[float], hertz: float) -> Floats:
        return np.array(size) * np.sin(
            2 * np.pi * hertz * rng.uniform(0.6, 1.4, 3) * t + rng.uniform(0, 6.28, 3)
        )

    place = np.array([-0.15, -0.05, 0.25]) + wave((0.15, 0.12, 0.08), 0.25)
    start = Rigid.from_quaternion(
        np.array([0, 0, -math.sin(math.pi / 8), math.cos(math.pi / 8)]), np.zeros(3)
    )
    turn = matrix_from_rotvec(wave((0.45, 0.45, 0.5), 0.2)) @ start.rotation
    position, quaternion = truth.position.copy(), truth.quaternion.copy()
    position[0], quaternion[0] = place, quaternion_from_matrix(turn)
    return replace(truth, position=position, quaternion=quaternion)


def turned(truth: GroundTruth) -> GroundTruth:
    """Both boxes turn to and fro where they stand, all their markers in view."""
    half = -math.pi / 4 + 0.5 * np.sin(2 * np.pi * np.arange(truth.n_frames) / 40)
    turn = np.stack([0 * half, 0 * half, np.sin(half / 2), np.cos(half / 2)], -1)
    place = np.array([[-0.2, -0.05, 0.0762], [0.2, 0.0, 0.0762]])[:, None].repeat(truth.n_frames, 1)
    return replace(truth, position=place, quaternion=np.stack([turn, turn]))


def take(kind: str, seed: int, n: int) -> Take:
    """Render, and look for markers and the table."""
    truth = sample_session(seed=seed, actions=[ACTIONS[seed % len(ACTIONS)]])[1]
    first = max(0, int(np.flatnonzero(truth.moving.any(0))[0]) - 15)
    if kind == "carried":
        truth, first = carried(truth, seed), 0
    elif kind == TURNED:
        truth, first = turned(truth), 0
    elif kind == "far":
        place = truth.scene.depth_from_table
        back = Rigid(place.rotation, place.translation + np.array([0, 0.05, 0.45]))
        truth = replace(truth, scene=replace(truth.scene, depth_from_table=back))
    frames = np.arange(first, min(first + n, truth.n_frames))
    renderer = Renderer(truth, seed=seed)
    index, t_ns = np.arange(len(frames)), truth.t_ns[frames] - truth.t_ns[first]
    depths = [renderer.depth(float(f) + LATER) for f in frames]
    depth = Film(index, t_ns + int(LATER * 1e9 / 30), renderer.cameras["depth"], depths.__getitem__)

    def grey(i: int) -> NDArray[Any]:
        return cv2.cvtColor(renderer.color(int(frames[i])), cv2.COLOR_BGR2GRAY)

    color = Film(index, t_ns, renderer.cameras["color"], grey)
    markers = track_markers(color, TrackParameters(prototypes=truth.prototypes), depth)
    true = truth.scene.depth_from_table @ Rigid(truth.poses.rotation[:, frames], truth.position[:, frames])
    clock = pa.table({"frame": pa.array(index, pa.int32()), "t_ns": pa.array(t_ns)})
    plane = fit_table_in_depth(depth)
    return Take(kind, clock, color.camera, depth, markers, plane, true, truth.prototypes)


def one_face(markers: pa.Table) -> pa.Table:
    """Only one face of each box in each frame, not always the largest."""
    frame, order = markers["frame"].to_numpy(), markers["order"].to_numpy()
    names = np.array(markers["object_id"].to_pylist())
    kept = np.zeros(len(frame), bool)
    for name in np.unique(names):
        for f in np.unique(frame[names == name]):
            rows = np.flatnonzero((names == name) & (frame == f))
            kept[rows[np.argsort(order[rows])[int(f) // 30 % len(rows)]]] = True
    return markers.filter(pa.array(kept))


@dataclass(frozen=True)
class Errors:
    """What poses are off by (n,); ``far_m`` is how far from the camera the box is."""

    mm: Floats
    degrees: Floats
    nees: Floats
    far_m: Floats
    wanted: int

    @classmethod
    def joined(cls, parts: Sequence[Errors]) -> Errors:
        """All of them."""
        mm, degrees, nees, far = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("mm", "degrees", "nees", "far_m")
        )
        return cls(mm, degrees, nees, far, sum(part.wanted for part in parts))


def errors(shot: Take, poses: pa.Table, source: str | None = None) -> Errors:
    """Of all boxes; ``wanted`` counts the frames in which a box was seen at all.  ``source``: only of these poses."""
    table, parts = table_frame(shot.plane), list[Errors]()
    for b, name in enumerate(object_ids(shot.prototypes)):
        rows = poses.filter(pc.field("object_id").cast(pa.string()) == name)
        if not rows.num_rows:
            continue
        numbers = [
            np.array(rows[c].to_numpy(zero_copy_only=False), float)
            for c in ("x", "y", "z", "qx", "qy", "qz", "qw")
        ]
        found = Rigid.from_quaternion(np.stack(numbers[3:], 1), np.stack(numbers[:3], 1))
        true = table.inverse() @ Rigid(shot.true.rotation[b], shot.true.translation[b])
        apart = Rigid(true.rotation @ np.swapaxes(found.rotation, 1, 2), true.translation - found.translation)
        seen = np.isfinite(numbers[0])
        if source is not None:
            seen &= np.array([value == source for value in rows["source"].to_pylist()], bool)
        off = np.concatenate([apart.translation, 2 * apart.quaternion[:, :3]], 1)[seen]
        spread = pose_covariances(rows)[seen]
        nees = np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[..., None])[..., 0]) / 6
        turned = quaternion_angle(found.quaternion, true.quaternion)[seen]
        far = np.linalg.norm(shot.true.translation[b][seen], axis=1)
        wanted = len(
            set(shot.markers.filter(pc.field("object_id").cast(pa.string()) == name)["frame"].to_pylist())
        )
        parts.append(Errors(1e3 * np.linalg.norm(off[:, :3], axis=1), np.degrees(turned), nees, far, wanted))
    return Errors.joined(parts)


def show(what: str, found: Sequence[Errors]) -> None:
    """Print a row of the table."""
    e = Errors.joined(found)
    if not len(e.mm):
        return
    mm, turn = np.percentile(e.mm, [50, 95, 99]), np.percentile(e.degrees, [50, 95, 99])
    cells = [what, len(e.mm), f"{100 * len(e.mm) / e.wanted:.1f}", f"{e.far_m.min():.2f}-{e.far_m.max():.2f}"]
    cells += [f"{value:.2f}" for value in (*mm, *turn, np.median(e.nees), e.nees.mean())]
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def solved(
    shot: Take, prototypes: tuple[BoxPrototype, ...], markers: pa.Table, *, depth: bool = True
) -> pa.Table:
    """The poses, frame by frame."""
    planes = None
    if depth:
        parameters = FacePlaneParameters(prototypes=prototypes, camera=shot.color)
        planes = fit_face_planes(markers, shot.depth, parameters)
    parameters = PoseParameters(prototypes=prototypes, camera=shot.color, noise=SUBPIXEL)
    return estimate_poses(shot.clock, markers, None, shot.plane, parameters, face_planes=planes)


def nominal(box: BoxPrototype) -> BoxPrototype:
    """The box with its markers where they should be: in the middle of the faces, square to the edges."""
    faces: list[MarkerFace] = []
    for face in box.faces:
        x, y, z = (float(n * edge / 2) for n, edge in zip(face_normal(face.face), box.size_m, strict=True))
        turn = (
            Rigid.from_quaternion(np.array(face.quaternion), np.zeros(3)).rotation.round().astype(np.float64)
        )
        qx, qy, qz, qw = (float(q) for q in quaternion_from_matrix(turn))
        faces.append(MarkerFace(face.face, face.code, 0.089, (x, y, z), (qx, qy, qz, qw)))
    return BoxPrototype(box.name, box.size_m, tuple(faces))


def aligned(box: BoxPrototype, true: BoxPrototype) -> BoxPrototype:
    """The box with its axes named as those of the true one: calibration cannot know which face is called front."""
    places = {face.code: np.array(face.centre) for face in true.faces}
    shared = [face for face in box.faces if face.code in places]
    first = np.stack([face.centre for face in shared])
    second = np.stack([places[face.code] for face in shared])
    u, _, vt = np.linalg.svd(second.T @ first)
    turn = Rigid(np.rint(u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt), np.zeros(3))
    faces: list[MarkerFace] = []
    for face in box.faces:
        moved = turn @ Rigid.from_quaternion(np.array(face.quaternion), np.array(face.centre))
        x, y, z = (float(c) for c in moved.translation)
        qx, qy, qz, qw = (float(q) for q in moved.quaternion)
        name = next(n for n in FACES if np.array(face_normal(n)) @ moved.rotation[:, 2] > 0.9)
        faces.append(replace(face, face=name, centre=(x, y, z), quaternion=(qx, qy, qz, qw)))
    return replace(box, faces=tuple(faces))


def measured_in(shot: Take, every: int = 6) -> tuple[BoxPrototype, ...]:
    """The boxes as a recording shows them; nominal ones in the place of those that it does not."""
    parameters = CalibrationParameters(camera=shot.color, noise=SUBPIXEL, every=every)
    try:
        found = calibrate_boxes(recordings_on(shot.plane, shot.markers), parameters).prototypes
    except InputError:
        found = ()
    known = {box.name: box for box in found if box.faces[0].sigma_m is not None}
    return tuple(
        aligned(known[true.name], true) if true.name in known else nominal(true) for true in shot.prototypes
    )


def speed(shot: Take, prototypes: tuple[BoxPrototype, ...]) -> None:
    """Milliseconds per frame of what is not image decoding."""
    planes = FacePlaneParameters(prototypes=prototypes, camera=shot.color)
    n = shot.clock.num_rows
    marks = [time.process_time()]
    found = fit_face_planes(shot.markers, shot.depth, planes)
    marks.append(time.process_time())
    poses = solved(shot, prototypes, shot.markers, depth=False)
    marks.append(time.process_time())
    smooth_poses(poses)
    marks.append(time.process_time())
    cells = [f"{1e3 * taken / n:.2f}" for taken in np.diff(marks)]
    print(
        f"\nms per frame: face planes ({found.num_rows / n:.1f} faces) {cells[0]}, "
        f"poses {cells[1]}, smoothing {cells[2]}"
    )


def camera_moved(seed: int, n: int = 40) -> None:
    """Print how far standing boxes jump on the table when the camera is moved half way."""
    rng = np.random.default_rng([seed, 8])
    move = Rigid(matrix_from_rotvec(rng.uniform(-0.1, 0.1, 3)), rng.uniform(-0.15, 0.15, 3))
    truth = sample_session(seed=seed, actions=[ACTIONS[seed % len(ACTIONS)]])[1]
    scene = replace(truth.scene, depth_from_table=move @ truth.scene.depth_from_table)
    places = Renderer(truth, seed=seed), Renderer(replace(truth, scene=scene), seed=seed)
    index, t_ns, cameras = np.arange(n), truth.t_ns[:n], places[0].cameras

    def grey(i: int) -> NDArray[Any]:
        return cv2.cvtColor(places[i >= n // 2].color(i), cv2.COLOR_BGR2GRAY)

    color = Film(index, t_ns, cameras["color"], grey)
    depth = Film(index, t_ns, cameras["depth"], lambda i: places[i >= n // 2].depth(float(i)))
    markers = track_markers(color, TrackParameters(prototypes=truth.prototypes), depth)
    clock = pa.table({"frame": pa.array(index, pa.int32()), "t_ns": pa.array(t_ns)})
    parameters = PoseParameters(prototypes=truth.prototypes, camera=color.camera, noise=SUBPIXEL)
    fit = PlaneParameters(prototypes=truth.prototypes, camera=color.camera, noise=SUBPIXEL)
    untied = fit_table_in_depth(depth)
    for what, plane in (
        ("each plane by itself", untied),
        ("boxes hidden", PLANE.run({}, {"depth": depth}, fit)["table_plane"]),
        ("boxes seen", PLANE.run({"markers_2d": markers}, {"depth": depth}, fit)["table_plane"]),
    ):
        poses = estimate_poses(clock, markers, None, plane, parameters)
        jumps: list[str] = []
        for b, name in enumerate(object_ids(truth.prototypes)):
            if truth.moving[b, :n].any():
                continue
            rows = poses.filter(pc.field("object_id").cast(pa.string()) == name)
            xyz = np.stack([np.array(rows[a].to_numpy(zero_copy_only=False), float) for a in "xyz"], 1)
            jump = np.nanmedian(xyz[n // 2 :], 0) - np.nanmedian(xyz[: n // 2], 0)
            jumps.append(f"{1e3 * np.linalg.norm(jump):.2f}")
        print(f"| {seed} | {what} | {plane['tie'].to_pylist()[1:]} | {', '.join(jumps)} |", flush=True)


def main() -> None:
    """Render, measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[901, 902])
    parser.add_argument("--frames", type=int, default=90)
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    shots = [take(kind, seed, asked.frames) for seed in asked.seeds for kind in KINDS]
    report(shots, take(TURNED, asked.seeds[0], 40))
    print("\n| camera moved, seed | what is known | tied by | blocks jump by mm |\n|---|---|---|---|")
    for seed in asked.seeds:
        camera_moved(seed)


def report(shots: Sequence[Take], measured: Take) -> None:
    """Print the figures of recordings, with the markers where one of them shows them to be."""
    order = measured_in(measured, every=1)
    known = tuple(
        replace(p, faces=tuple(replace(f, sigma_m=1e-4) for f in p.faces)) for p in shots[0].prototypes
    )
    print(
        "| geometry | frames | coverage % | m | mm median | 95 % | 99 % "
        "| degrees median | 95 % | 99 % | NEES median | mean |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    print("| reach, unsmoothed / smoothed | | | 1-2 | 3 / 1.5 | 8 / 4 | | 0.7 | 2 | | 1 | 1 |")
    n = len(shots)
    for name, boxes in (
        ("fitted", [order] * n),
        ("own", [measured_in(shot) for shot in shots]),
        ("nominal", [tuple(map(nominal, known))] * n),
        ("exact", [known] * n),
    ):
        poses = [solved(shot, mine, shot.markers) for shot, mine in zip(shots, boxes, strict=True)]
        frame_by_frame = [errors(shot, one) for shot, one in zip(shots, poses, strict=True)]
        smoothed = [errors(shot, smooth_poses(one)) for shot, one in zip(shots, poses, strict=True)]
        show(f"{name}, unsmoothed", frame_by_frame)
        show(f"{name}, smoothed", smoothed)
        filled = [
            errors(shot, smooth_poses(one), "interpolated") for shot, one in zip(shots, poses, strict=True)
        ]
        show(f"{name}, filled in only", filled)
        for kind in KINDS if name == "fitted" else ():
            for what, found in (("unsmoothed", frame_by_frame), ("smoothed", smoothed)):
                show(f"... {kind}, {what}", [e for e, s in zip(found, shots, strict=True) if s.kind == kind])
    one = [replace(shot, markers=one_face(shot.markers)) for shot in shots]
    for depth in (True, False):
        poses = [solved(shot, order, shot.markers, depth=depth) for shot in one]
        what = f"fitted, one face only, {'with' if depth else 'without'} depth"
        show(f"{what}, unsmoothed", [errors(*pair) for pair in zip(one, poses, strict=True)])
        show(f"{what}, smoothed", [errors(s, smooth_poses(p)) for s, p in zip(one, poses, strict=True)])
    speed(shots[0], order)


if __name__ == "__main__":
    main()
