"""LeRobot data sets, format v3.0: written with pyarrow and PyAV, read by lerobot, Rerun, and whatever reads these.

https://github.com/huggingface/lerobot; docs/formats/lerobot.md says what is carried.  Not carried: relations, roles and
links of events, shapes drawn by people, tables beside poses and joints, sound, infrared images, the recording's own
times (those of images are at most half a step off, and ``meta/ecat.json`` tells how far), depth beyond 12 bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ecat.formats.format import Format, Part
from ecat.formats.lerobot.options import LeRobotOptions
from ecat.progress import Progress
from ecat.store import Session


def _part(
    session: Session, label: str, dest: Path, options: LeRobotOptions, progress: Progress
) -> tuple[str, ...]:
    from ecat.formats.lerobot.part import write_part

    return write_part(session, label, dest, options, progress)


def _merge(parts: Sequence[Part], dest: Path, options: LeRobotOptions, progress: Progress) -> tuple[str, ...]:
    from ecat.formats.lerobot.merge import merge

    return merge(parts, dest, options, progress)


FORMAT = Format(
    name="lerobot",
    description="LeRobot data set v3.0: state, action, video, depth and sub-events at a regular rate",
    part=_part,
    merge=_merge,
    options=LeRobotOptions,
)
