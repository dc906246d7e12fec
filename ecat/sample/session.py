"""A whole sample session: script, truth, sensors, annotation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ecat.geometry.cameras import KINECT_V2_DEPTH
from ecat.model import Clock, Manifest, Provenance, Stream
from ecat.sample.annotation import RIG_ID, annotate
from ecat.sample.scene import manifest_camera, random_scene
from ecat.sample.script import ACTIONS, write_script
from ecat.sample.sensor import NoiseModel, joints, markers
from ecat.sample.simulate import simulate
from ecat.sample.truth import GroundTruth

if TYPE_CHECKING:
    from ecat.store import Draft

_CREATED = "2024-03-05T10:00:00"
_STAMP = "3_5_2024_10_00_00AM"


def sample_session(
    *,
    seed: int,
    actions: Sequence[str] = ACTIONS,
    name: str | None = None,
    noise: NoiseModel = NoiseModel(),  # noqa: B008  (frozen)
) -> tuple[Draft, GroundTruth]:
    """A session that never was, and what really happened in it.

    Two marked cubes, "Shell" (o2) and "Stella Artois" (o3), stand on a table (o4); a seated performer (o1) slides one
    of them next to, past, around, toward or away from the other, once for each of ``actions``.  The same seed, actions
    and noise give the same session bit for bit; the noise does not change what happens.

    Parameters
    ----------
    seed : not negative.
    actions : names from ``ACTIONS``; any number, any order.
    name : of the session; ``sample_<seed>`` if not given.
    noise : of the sensors.

    Raises
    ------
    UsageError : no actions, or an unknown one.
    """
    from ecat.store import Draft, TableData

    script, world, sensor, person = (
        np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, k]))) for k in range(4)
    )
    scene = random_scene(world)
    start, moves, n_frames = write_script(script, scene, actions)
    # the recorder's clock runs at 29.9 to 30 frames per second and counts milliseconds
    duration_ms = round((n_frames - 1) * 1000 / world.uniform(29.9, 30.0))
    clock = Clock(rule="uniform", start=_CREATED, duration_ns=duration_ms * 1_000_000)
    name = name if name is not None else f"sample_{seed:04d}"
    truth = simulate(
        name=name, seed=seed, clock=clock, scene=scene, start=start, moves=moves, n_frames=n_frames
    )
    markers_2d, markers_3d = markers(truth, noise, sensor)
    tables = {"joints": joints(truth, noise, sensor, RIG_ID), "markers_2d": markers_2d, "markers_3d": markers_3d}
    draft = Draft(
        manifest=_manifest(truth),
        layers=(annotate(truth, noise, person),),
        tables={key: TableData(data=table) for key, table in tables.items()},
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
            Stream(name="color", kind="color", file=f"media/rgb_{_STAMP}.avi", codec="mpeg4", camera="color", n_frames=n),
            Stream(name="depth", kind="depth", file=f"media/depth_{_STAMP}.dep", codec="raw", camera="depth", n_frames=n),
            Stream(name="skeleton", kind="skeleton", file=f"media/rig_{_STAMP}.xml", n_frames=n),
            Stream(name="body_scheme", kind="other", file="media/bodyScheme.xml"),
        ),
        provenance=Provenance(format="sample", source=f"seed {truth.seed}", notes=("generated; there are no images",)),
    )
