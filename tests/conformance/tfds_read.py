"""What tensorflow_datasets finds in a folder, as JSON: run by tests in an environment that has it."""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """Texts and numbers; of images their shape and mean."""
    if isinstance(value, dict):
        return {name: plain(inside) for name, inside in value.items()}
    array = np.asarray(value)
    if array.ndim == 3 and array.dtype == np.uint8:
        return {"shape": array.shape, "mean": float(array.mean())}
    return value.decode() if isinstance(value, bytes) else array.tolist()


def main(folder: str) -> None:
    """Print every episode of the split train."""
    import tensorflow_datasets as tfds  # pyright: ignore[reportMissingImports]

    data = tfds.builder_from_directory(folder).as_dataset(split="train", shuffle_files=False)
    found = [
        {
            "episode_metadata": plain(episode["episode_metadata"]),
            "steps": [plain(s) for s in episode["steps"]],
        }
        for episode in tfds.as_numpy(data)
    ]
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1])
