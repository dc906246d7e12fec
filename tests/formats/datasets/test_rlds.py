"""Episodes as RLDS: records, read by protobuf, and the whole by tensorflow_datasets where it is."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat import formats
from ecat.errors import UsageError
from ecat.formats.datasets import rlds
from ecat.formats.datasets.made import Columns
from tests.formats.datasets.examples import read_records
from tests.formats.datasets.moments import Make, Span

GRASP = Span(10, 50, parts=(("grasp", 10, 20),))
ROOT = Path(__file__).parents[3]
TFDS = Path(os.environ.get("ECAT_TFDS_ENV", ROOT / ".venv" / "tfds")) / "bin" / "python"


@pytest.fixture
def folder(make: Make) -> Path:
    """A session without images, and one with; only a box called red is in both."""
    make("a", Span(0, 5))
    return exported(
        make("b", GRASP, Span(52, 60, "push"), number=2, film=True, boxes=("green", "red")).parent
    )


def exported(project: Path, **options: str) -> Path:
    dest = project.with_name("dataset")
    formats.export(project, dest, format="rlds", options=options)
    return dest


def records(folder: Path) -> list[dict[str, list[Any]]]:
    return [r for path in sorted(folder.glob("*.tfrecord-*")) for r in read_records(path.read_bytes())]


def said(folder: Path, name: str) -> Any:
    return json.loads((folder / f"{name}.json").read_text())


def matrix(record: dict[str, list[Any]], name: str) -> Any:
    return np.array(record[name]).reshape(len(record["steps/t_ns"]), -1)


def brightness(jpeg: bytes) -> float:
    import cv2

    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return float(image.mean())


def test_a_record_is_an_episode(folder: Path) -> None:
    found = records(folder)
    assert [len(record["steps/t_ns"]) for record in found] == [5, 40, 8]
    assert [record["episode_metadata/session"] for record in found] == [[b"a"], [b"b"], [b"b"]]
    second = found[1]
    assert set(second["steps/language_instruction"]) == {b"slide 0"}
    assert second["steps/subtask"] == [b"grasp"] * 10 + [b""] * 30
    assert second["steps/is_first"] == [1] + [0] * 39
    assert second["steps/is_last"] == second["steps/is_terminal"] == second["steps/reward"] == [0] * 39 + [1]
    assert second["steps/discount"] == [1] * 40
    assert second["steps/t_ns"][0] == 333_333_333


def test_all_episodes_have_the_same_columns_and_say_what_they_know(folder: Path) -> None:
    names = said(folder, "ecat")["state"]
    red, green, blue = (names.index(f"{box}.x") for box in ("red", "green", "blue"))
    first, second, _ = records(folder)
    np.testing.assert_allclose(matrix(first, "steps/observation/state")[:, red], 1 + np.arange(5) / 1000)
    known = matrix(first, "steps/observation/state_known")[0, [red, green, blue]]
    np.testing.assert_array_equal(known, [1, 0, 1])
    np.testing.assert_array_equal(
        matrix(second, "steps/observation/state_known")[0, [red, green, blue]], [1, 1, 0]
    )
    # what is nowhere known in an episode is zero
    np.testing.assert_array_equal(matrix(second, "steps/observation/state")[:, blue], 0)
    assert said(folder, "features")["featuresDict"]["features"].keys() == {"episode_metadata", "steps"}


def test_each_moment_has_an_image_or_a_black_one(folder: Path) -> None:
    first, second, _ = records(folder)
    gray = [brightness(jpeg) for jpeg in second["steps/observation/color"]]
    np.testing.assert_allclose(gray, 4 * np.arange(10, 50), atol=4)
    assert second["steps/observation/color_known"] == [1] * 40
    assert [brightness(jpeg) for jpeg in first["steps/observation/color"]] == [0] * 5
    assert first["steps/observation/color_known"] == [0] * 5


def test_files_are_as_large_as_allowed_and_counted(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    project = make("a", *(Span(10 * i, 10 * i + 10) for i in range(6)), film=True).parent
    whole = exported(project)
    size = (whole / "ecat-train.tfrecord-00000-of-00001").stat().st_size
    whole.rename(whole.with_name("whole"))
    monkeypatch.setattr(rlds, "_MEGABYTE", size // 3)
    folder = exported(project, shard_mb="1", name="mine")
    (split,) = said(folder, "dataset_info")["splits"]
    n = len(split["shardLengths"])
    assert n >= 3
    paths = sorted(folder.glob("*.tfrecord*"))
    assert [path.name for path in paths] == [f"mine-train.tfrecord-{i:05d}-of-{n:05d}" for i in range(n)]
    assert [len(list(read_records(path.read_bytes()))) for path in paths] == [
        *map(int, split["shardLengths"])
    ]
    assert sum(
        path.stat().st_size - 16 * int(k) for path, k in zip(paths, split["shardLengths"], strict=True)
    ) == (int(split["numBytes"]))
    assert max(path.stat().st_size for path in paths) <= size // 3


def test_what_there_is_not_is_left_out_and_said(make: Make, tmp_path: Path) -> None:
    project = make("a", GRASP).parent
    formats.export(project, tmp_path / "without", format="rlds")
    (record,) = records(tmp_path / "without")
    assert not [name for name in record if "color" in name]
    columns, shapes = Columns(streams=["color"], state=["red.x"]), rlds.Shapes()
    assert list(rlds.left_out(columns, shapes)) == [
        "no image of stream color is shown: it was left out",
        "there is no action: it was left out",
    ]


def test_an_episode_too_large_for_a_message_is_refused(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    from ecat.errors import InputError

    project = make("a", GRASP).parent
    monkeypatch.setattr(rlds, "_MOST_BYTES", 1000)
    with pytest.raises(InputError, match="episode 0 of a"):
        exported(project)
    assert not project.with_name("dataset").exists()


def test_a_name_that_readers_refuse_is_refused(make: Make) -> None:
    with pytest.raises(UsageError, match="name=My data"):
        exported(make("a", GRASP).parent, name="My data")


def test_the_same_sessions_give_the_same_bytes(make: Make, tmp_path: Path) -> None:
    project = make("a", GRASP, film=True).parent
    for name in ("one", "two"):
        formats.export(project, tmp_path / name, format="rlds")
    names = [p.name for p in (tmp_path / "one").iterdir()]
    assert len(names) == 4
    assert all((tmp_path / "one" / n).read_bytes() == (tmp_path / "two" / n).read_bytes() for n in names)


@pytest.mark.slow
@pytest.mark.skipif(not TFDS.exists(), reason="no tensorflow_datasets: run tests/conformance/tfds_env.sh")
def test_tensorflow_datasets_reads_it(folder: Path) -> None:
    reader = ROOT / "tests" / "conformance" / "tfds_read.py"
    done = subprocess.run([TFDS, reader, folder], capture_output=True, check=False, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert [len(episode["steps"]) for episode in found] == [5, 40, 8]
    metadata, step = found[1]["episode_metadata"], found[1]["steps"][3]
    assert (metadata["session"], metadata["label"], step["subtask"]) == ("b", "slide", "grasp")
    assert step["observation"]["color"]["shape"] == [48, 64, 3]
    assert step["observation"]["color"]["mean"] == pytest.approx(4 * 13, abs=3)
    place = said(folder, "ecat")["state"].index("green.x")
    assert step["observation"]["state"][place] == pytest.approx(2.013)
    assert step["observation"]["state_known"][place] is True
