"""Writes some episodes of a data set anew with lerobot's own writer, in its own environment, and tells what it took.

    PYTHONPATH=tests/conformance/stubs .venv/lerobot/bin/python tests/conformance/lerobot_write.py \
        SOURCE DEST N_EPISODES CODEC STREAMING

The episodes of SOURCE, which has one colour camera, are read and decoded beforehand; what is timed is handing them to
lerobot frame by frame, saving each episode, and closing the data set.  Prints ``frames``, ``cpu_s`` (processor time of
all threads and processes) and ``wall_s`` as JSON.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Iterator
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

KEY = "observation.images.color"
VECTORS = ("observation.state", "action", "state_known", "action_known")


def episodes(source: Path, n: int) -> Iterator[list[dict[str, Any]]]:
    """The frames of the first n episodes, as lerobot wants them."""
    import av
    import numpy as np
    import pyarrow.parquet as pq

    tasks = pq.read_table(source / "meta/tasks.parquet").to_pandas()
    data = pq.ParquetFile(source / "data/chunk-000/file-000.parquet")
    rows = [row for g in range(n) for row in data.read_row_group(g).to_pylist()]
    facts = pq.read_table(source / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    for episode in facts[:n]:
        file = f"chunk-000/file-{episode[f'videos/{KEY}/file_index']:03d}.mp4"
        first = round(episode[f"videos/{KEY}/from_timestamp"] * 30)
        with av.open(str(source / "videos" / KEY / file)) as container:
            wanted = islice(container.decode(video=0), first, first + episode["length"])
            images: list[Any] = [frame.to_ndarray(format="rgb24") for frame in wanted]
        mine = rows[episode["dataset_from_index"] : episode["dataset_to_index"]]
        yield [
            {name: np.array(row[name], np.float32) for name in VECTORS}
            | {KEY: image, "task": tasks.iloc[row["task_index"]].name}
            for row, image in zip(mine, images, strict=True)
        ]


def used_s() -> float:
    """Seconds of processor of this process and those that it started."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(usage.ru_utime + usage.ru_stime for usage in map(resource.getrusage, kinds))


def main(source: Path, dest: Path, n: int, codec: str, *, streaming: bool) -> None:
    """Write, and print what it took."""
    features = json.loads((source / "meta/info.json").read_bytes())["features"]
    wanted = {key: features[key] for key in (*VECTORS, KEY)}
    for feature in wanted.values():
        feature.pop("info", None)
        feature["shape"] = tuple(feature["shape"])
    own: Any = import_module("lerobot.datasets.lerobot_dataset")
    writer = own.LeRobotDataset.create(
        "ecat/benchmark",
        fps=30,
        features=wanted,
        root=dest,
        robot_type="human",
        use_videos=True,
        vcodec=codec,
        streaming_encoding=streaming,
    )
    frames = 0
    cpu = wall = 0.0
    for episode in episodes(source, n):
        cpu, wall = cpu - used_s(), wall - time.perf_counter()
        for frame in episode:
            writer.add_frame(frame)
        writer.save_episode()
        cpu, wall, frames = cpu + used_s(), wall + time.perf_counter(), frames + len(episode)
    cpu, wall = cpu - used_s(), wall - time.perf_counter()
    writer.finalize()
    cpu, wall = cpu + used_s(), wall + time.perf_counter()
    print(json.dumps({"frames": frames, "cpu_s": cpu, "wall_s": wall}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4], streaming=sys.argv[5] == "yes")
