"""Rerun's own reader of LeRobot data sets (written in Rust by others) finds everything."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from tests.formats.lerobot.conftest import DataSet, Export
from tests.formats.lerobot.recordings import Action, Recording

COLOR, DEPTH = "observation.images.color", "observation.images.depth"
ACTIONS = (
    Action(start=0, end=20, parts=(("hold", 5, 15), ("move", 7, 12))),
    Action(start=17, end=50, text="Slide blue past red", theme="o2", parts=(("hold", 20, 40),)),
)


def streamed(found: DataSet, episode: int) -> dict[str, list[Any]]:
    """What the reader hands out, by entity and component, in the order of frames."""
    from rerun.experimental import LeRobotReader

    columns: dict[str, list[Any]] = defaultdict(list)
    for chunk in LeRobotReader(found.root).stream(episode):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if ":" in name:
                columns[f"{chunk.entity_path[1:]}:{name.partition(':')[2]}"] += batch.column(name).to_pylist()
        if "frame_index" in batch.schema.names:
            columns[f"{chunk.entity_path[1:]}:frame"] += (
                batch.column("frame_index").cast(pa.int64()).to_pylist()
            )
    return columns


@pytest.mark.parametrize("language", ["columns", "index"])
def test_rerun_reads_every_number_word_and_image(export: Export, language: str) -> None:
    views = ("color", "depth")
    found = export(
        Recording(name="a", views=views, actions=ACTIONS, joints=True),
        Recording(name="b", views=views, actions=ACTIONS[:1], boxes=("red",)),
        language=language,
    )
    for number, episode in enumerate(found.episodes):
        n, rows = episode["length"], slice(episode["dataset_from_index"], episode["dataset_to_index"])
        seen = streamed(found, number)
        for key in ("observation.state", "action", "state_known", "action_known"):
            assert np.array(seen[f"{key}:scalars"]) == pytest.approx(found.column(key)[rows], abs=1e-6), key
        assert seen["action:frame"][:n] == list(range(n))
        assert [text[0] for text in seen["task:text"]] == episode["tasks"] * n
        for key in (COLOR, DEPTH):
            assert len(seen[f"{key}:sample"]) == n
        said = "language_persistent/subtask/assistant:text" if language == "columns" else "subtask:text"
        assert {text[0] for text in seen[said]} == (
            {"hold"} if episode["event"] == "a1" else {"hold", "move"}
        )


def test_rerun_finds_all_episodes_and_what_is_said_about_them(export: Export) -> None:
    from rerun.experimental import LeRobotReader

    found = export(Recording(actions=ACTIONS))
    reader = LeRobotReader(found.root)
    assert (reader.version, reader.episodes()) == ("v3", [0, 1])
    assert '"codebase_version": "v3.0"' in str(reader.metadata().to_record_batch().to_pylist())
