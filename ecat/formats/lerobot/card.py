"""The card of a data set: what it is, for people and for the Hugging Face Hub."""

from __future__ import annotations

from ecat.formats.lerobot.dataset import DatasetWriter
from ecat.formats.lerobot.layout import Layout
from ecat.formats.lerobot.options import LeRobotOptions

_HEAD = """\
---
task_categories:
- robotics
tags:
- LeRobot
configs:
- config_name: default
  data_files: data/*/*.parquet
---

{episodes} episodes of people handling objects, {frames} moments at {fps} Hz, {tasks} tasks.
LeRobot format v3.0, written by ecat.

- Clock: {clock} Images are the nearest in time. What is known only further away than {gap:g} s counts as unknown.
  `meta/ecat.json` says how far off images are, and which videos were encoded anew.
- `observation.state`: metres and unit quaternions (x, y, z, w) in the frame of the table, whose z axis points up;
  `closed` is 1 while a hand holds a box.
- `action`: {action}
- Unknown numbers repeat the last known one, or are zero where there is none; `state_known` and `action_known` tell.
- Videos: {views}.
"""
_DEPTH = (
    "- Depth has 12 bits (steps of 1.5 mm at 1 m); pixels without depth come out as the nearest, 10 mm.\n"
)
_WORDS = "- Sub-events were annotated by people; no text was generated.\n"
_COLUMNS = "- The language columns need lerobot 0.6; for 0.4, export with `--option language=index`.\n"
_SPLIT = "- Splits: the last {n} episodes are `test`, of {kind}s that `train` has not.\n"
_CLOCKS = {
    "nearest": "numbers at a moment are those of the recorded frame nearest in time.",
    "linear": "numbers at a moment lie on a line between the recorded frames before and after it.",
    "images": "each image of the annotated video is one moment, as if the camera had kept exactly to that rate.",
}
_ACTIONS = {
    "next_pose": "the pose of the box that the episode's event moves, one moment later.",
    "delta": "the way of the box that the episode's event moves to its pose one moment later: metres, and a\n"
    "  rotation vector about the axes of the table, radians.",
    "next_state": "the state one moment later.",
    "none": "none.",
}


def text(shape: Layout, writer: DatasetWriter, options: LeRobotOptions, n_test: int) -> str:
    """The README of a data set that ``writer`` has written."""
    views = ", ".join(f"`{key}` ({view.width} x {view.height})" for key, view in shape.views.items())
    head = _HEAD.format(
        episodes=writer.n_episodes,
        frames=writer.n_frames,
        fps=shape.fps,
        tasks=len(writer.tasks),
        clock=_CLOCKS[options.clock],
        gap=options.gap_s,
        action=_ACTIONS[options.action],
        views=views or "none",
    )
    depth = any(view.kind == "depth" for view in shape.views.values())
    return (
        head
        + (_DEPTH if depth else "")
        + (_WORDS if shape.language != "none" else "")
        + (_COLUMNS if shape.language == "columns" else "")
        + (_SPLIT.format(n=n_test, kind=options.split) if n_test else "")
    )
