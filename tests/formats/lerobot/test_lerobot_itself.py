"""lerobot reads with its own ``LeRobotDataset`` what ecat writes, every row and every image of it.

It needs an environment of its own, which `tests/conformance/lerobot_env.sh` makes.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat.formats.lerobot.depth import MOST
from tests.formats.lerobot.conftest import DataSet, Export
from tests.formats.lerobot.recordings import Action, Recording

pytestmark = pytest.mark.lerobot

HOME = Path(__file__).resolve().parents[3]
ENVIRONMENT = Path(os.environ.get("ECAT_LEROBOT_ENV", HOME / ".venv" / "lerobot"))
COLOR, DEPTH = "observation.images.color", "observation.images.depth"
ACTIONS = (
    Action(start=0, end=20, parts=(("hold", 5, 15), ("move", 7, 12))),
    Action(start=17, end=50, text="Slide blue past red", theme="o2", parts=(("hold", 20, 40),)),
)


def read_by_lerobot(found: DataSet, notes: Path) -> dict[str, Any]:
    """What lerobot got."""
    if not (ENVIRONMENT / ".installed").exists():
        pytest.skip("lerobot is not installed: tests/conformance/lerobot_env.sh installs it")
    folder = HOME / "tests" / "conformance"
    own = {"PYTHONPATH": str(folder / "stubs"), "HF_HOME": str(notes / "hub"), "HF_HUB_OFFLINE": "1"}
    python = str(ENVIRONMENT / "bin" / "python")
    done = subprocess.run(
        [python, str(folder / "lerobot_read.py"), str(found.root), str(notes / "notes.npz")],
        env=os.environ | own,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return dict(np.load(notes / "notes.npz"))


def test_lerobot_reads_every_row_and_image(export: Export, tmp_path: Path) -> None:
    views = ("color", "depth")
    found = export(
        Recording(name="a", views=views, actions=ACTIONS, joints=True),
        Recording(name="b", views=views, actions=ACTIONS[:1], boxes=("red",)),
        language="index",
    )
    assert found.how["video"][COLOR]["episodes_copied"] == 2
    seen = read_by_lerobot(found, tmp_path)
    rows = found.rows
    for name in rows.column_names:
        assert (seen[name] == found.column(name).astype(seen[name].dtype)).all(), name
    assert seen["task"].tolist() == [t for e in found.episodes for t in e["tasks"] * e["length"]]
    assert set(seen["subtask"].tolist()) == {"hold", "move"}

    files = sorted((found.root / "videos" / COLOR).glob("*/*.mp4"))
    ours = [image for file in files for image in found.images(COLOR, f"chunk-000/{file.name}")]
    means = np.array([image.mean(axis=(0, 1)) / 255 for image in ours])
    # another version of FFmpeg turns YUV into RGB there
    assert seen[f"{COLOR}/images"] == pytest.approx(means, abs=0.01)
    assert seen[f"{COLOR}/first"].transpose(1, 2, 0) == pytest.approx(ours[0] / 255, abs=0.06)
    # 0.4.4 does not know depth, and takes it for a grey picture
    grey = np.array([image.mean() / MOST for image in found.images(DEPTH)])
    assert seen[f"{DEPTH}/images"][:, 0] == pytest.approx(grey, abs=0.01)


def test_statistics_are_those_that_lerobot_computes(export: Export, tmp_path: Path) -> None:
    found = export(Recording(actions=ACTIONS), language="none")
    theirs = json.loads(str(read_by_lerobot(found, tmp_path)["stats"]))
    assert set(theirs) == {key for key in found.stats if key != COLOR}
    for key, said in theirs.items():
        ours = found.stats[key]
        span = np.array(said["max"], float) - np.array(said["min"], float)
        for name in ("min", "max", "mean", "std", "count"):
            # its deviations are differences of squares of 32 bits
            exact = (1e-4 if name == "std" else 2e-6) * (1 + span.max())
            assert np.array(ours[name]) == pytest.approx(np.array(said[name]), abs=exact), (key, name)
        assert list(ours) == list(said)
