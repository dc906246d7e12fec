"""Reads a data set with lerobot itself, in its own environment, and notes down what it got.

    PYTHONPATH=tests/conformance/stubs .venv/lerobot/bin/python tests/conformance/lerobot_read.py ROOT NOTES.npz

The notes: ``<column>`` (n, ...) of every number, ``task`` and ``subtask`` (n,), ``<key>/images`` the mean of every
image by channel (n, channels), ``<key>/first`` the first image (channels, height, width), ``stats`` of its own making
as JSON.
"""

from __future__ import annotations

import json
import sys
from importlib import import_module
from typing import Any


def main(root: str, notes: str) -> None:
    """Read everything."""
    import numpy as np

    # not installed where types are checked
    computing: Any = import_module("lerobot.datasets.compute_stats")
    data: Any = import_module("lerobot.datasets.lerobot_dataset").LeRobotDataset(
        "ecat/conformance", root=root, video_backend="pyav"
    )
    found: dict[str, list[Any]] = {}
    for number in range(len(data)):
        item = data[number]
        for key, value in item.items():
            if key in data.meta.camera_keys:
                found.setdefault(f"{key}/images", []).append(value.mean(dim=(1, 2)).numpy())
                if number == 0:
                    found[f"{key}/first"] = value.numpy()
            else:
                found.setdefault(key, []).append(value if isinstance(value, str) else value.numpy())
    arrays: dict[str, Any] = {key: np.array(value) for key, value in found.items()}
    numbers = {key: ft for key, ft in data.meta.features.items() if ft["dtype"] in ("float32", "int64")}
    episodes = [
        {key: arrays[key][arrays["episode_index"] == number] for key in numbers}
        for number in range(data.num_episodes)
    ]
    own = computing.aggregate_stats([computing.compute_episode_stats(rows, numbers) for rows in episodes])
    listed = {key: {name: np.ravel(value).tolist() for name, value in of.items()} for key, of in own.items()}
    save: Any = np.savez
    save(notes, **arrays, stats=json.dumps(listed))


if __name__ == "__main__":
    main(*sys.argv[1:3])
