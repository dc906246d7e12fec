"""A whole sample session: script, truth, sensors, annotation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from ecat.errors import UsageError
from ecat.geometry.cameras import KINECT_V2_COLOR, KINECT_V2_DEPTH, Camera
from ecat.model import Clock, Manifest, Provenance, Stream
from ecat.sample.annotation import RIG_ID, annotate
from ecat.sample.scene import manifest_camera, random_scene
from ecat.sample.script import ACTIONS, write_script
from ecat.sample.sensor import NoiseModel, joints, markers
from ecat.sample.simulate import simulate
from ecat.sample.truth import GroundTruth
from ecat.store import Draft, TableData

StreamKind: TypeAlias = Literal["color", "depth", "skeleton", "other"]
_CREATED = "2024-03-05T10:00:00"
_STAMP = "3_5_2024_10_00_00AM"


def sample_session(
    *,
    seed: int,
    actions: Sequence[str] = ACTIONS,
    name: str | None = None,
    noise: NoiseModel = NoiseModel(),  # noqa: B008  (frozen)
    color: Camera = KINECT_V2_COLOR,
) -> tuple[Draft, GroundTruth]:
    """A session that never was, and what really happened in it.

    Two marked cubes, "Shell" (o2) and "Stella Artois" (o3), stand on a table (o4); a seated performer (o1)
    slides one of them next to, past, around, toward or away from the other, once for each of ``actions``.
    The same seed, actions and noise give the same session bit for bit; noise does not change what happens.

    Parameters
    ----------
    seed : not negative.
    actions : names from ``ACTIONS``, in any order, at most ``MAX_ACTIONS``.
    name : of the session; ``sample_<seed>`` if not given.
    noise : of the sensors.
    color : the colour camera, seen from ``camera/depth``.

    Raises
    ------
    UsageError : no actions, too many, an unknown one, or a negative seed.
    """
    if seed < 0:
        raise UsageError("cannot make a sample session", where=f"seed {seed}", fix="give a seed of 0 or more")
    script, world, sensor, person = (
        np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, k]))) for k in range(4)
    )
    scene = replace(random_scene(world), color=color)
    start, moves, n_frames = write_script(script, scene, actions)
    # the recorder's clock runs at 29.9 to 30 frames per second and counts milliseconds
    duration_ms = round((n_frames - 1) * 1000 / world.uniform(29.9, 30.0))
    clock = Clock(rule="uniform", start=_CREATED, duration_ns=duration_ms * 1_000_000)
    name = name if name is not None else f"sample_{seed:04d}"
    truth = simulate(
        name=name, seed=seed, clock=clock, scene=scene, start=start, moves=moves, n_frames=n_frames
    )
    markers_2d, markers_3d = markers(truth, noise, sensor)
    draft = Draft(
        manifest=_manifest(truth),
        layers=(annotate(truth, noise, person),),
        tables={
            "markers_2d": TableData(data=markers_2d),
            "markers_3d": TableData(data=markers_3d),
            "joints": TableData(data=joints(truth, noise, sensor, RIG_ID)),
        },
    )
    return draft, truth


def _manifest(truth: GroundTruth) -> Manifest:
    n = truth.n_frames
    return Manifest(
        name=truth.name,
        created=_CREATED,
        n_frames=n,
        clock=truth.clock,
        cameras=(manifest_camera(truth.scene.color, "depth"), manifest_camera(KINECT_V2_DEPTH, "")),
        streams=(
            _absent("color", "color", f"rgb_{_STAMP}.avi", n_frames=n, codec="mpeg4", camera="color"),
            _absent("depth", "depth", f"depth_{_STAMP}.dep", n_frames=n, camera="depth"),
            _absent("skeleton", "skeleton", f"rig_{_STAMP}.xml", n_frames=n),
            _absent("body_scheme", "other", "bodyScheme.xml"),
        ),
        provenance=Provenance(
            format="sample", source=f"seed {truth.seed}", notes=("generated, without images",)
        ),
    )


def _absent(
    name: str, kind: StreamKind, file: str, *, n_frames: int | None = None, codec: str = "", camera: str = ""
) -> Stream:
    return Stream(name=name, kind=kind, file=f"media/{file}", n_frames=n_frames, codec=codec, camera=camera)
