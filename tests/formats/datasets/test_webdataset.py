"""Samples in TAR files, read by Python's tarfile and by webdataset."""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat import formats
from ecat.errors import InputError
from tests.formats.datasets.moments import Make, Span

GRASP = Span(10, 40, parts=(("grasp", 10, 20),))


def exported(project: Path, **options: str) -> Path:
    dest = project.with_name("dataset")
    formats.export(project, dest, format="webdataset", options=options)
    return dest


def samples(folder: Path) -> dict[str, dict[str, bytes]]:
    """The files of each sample, by what follows the key's dot."""
    found: dict[str, dict[str, bytes]] = {}
    for path in sorted(folder.glob("*.tar")):
        with tarfile.open(path) as tar:
            for member in tar:
                file = tar.extractfile(member)
                assert file is not None
                key, _, name = member.name.partition(".")
                found.setdefault(key, {})[name] = file.read()
    return found


def decoded(jpeg: bytes) -> Any:
    import cv2

    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)


def test_a_sample_is_a_window(make: Make) -> None:
    found = samples(exported(make("a", GRASP, film=True).parent, window_s="0.5", stride_s="0.25"))
    # 30 moments, 15 long, every 8
    assert len(found) == 2
    second = list(found.values())[1]
    about = json.loads(second["json"])
    assert (about["session"], about["episode"], about["window"], about["first_moment"]) == ("a", 0, 1, 8)
    assert (about["task"], about["label"], about["event"]) == ("slide 0", "slide", "e0")
    assert about["t_ns"][0] == 600_000_000
    assert about["subtasks"] == ["grasp"] * 2 + [""] * 13
    state = np.load(io.BytesIO(second["state.npy"]))
    assert state.shape == (15, len(about["state_names"]))
    np.testing.assert_allclose(
        state[:, about["state_names"].index("red.x")], 1 + np.arange(18, 33) / 1000, rtol=1e-6
    )
    assert np.load(io.BytesIO(second["action.npy"])).shape == (15, len(about["action_names"]))
    images = [second[f"color.{i:06d}.jpg"] for i in range(15)]
    np.testing.assert_allclose([decoded(i).mean() for i in images], 4 * np.arange(18, 33), atol=3)


def test_a_sample_is_an_episode_if_wanted(make: Make) -> None:
    project = make("a", GRASP, Span(45, 50)).parent
    about = [json.loads(s["json"]) for s in samples(exported(project, samples="episode")).values()]
    assert [(a["episode"], a["window"], len(a["t_ns"])) for a in about] == [(0, 0, 30), (1, 0, 5)]


def test_samples_of_all_sessions_have_the_same_columns(make: Make) -> None:
    make("a", Span(0, 10), number=1)
    folder = exported(make("b", Span(0, 10), number=2, boxes=("green", "red")).parent, samples="episode")
    names = json.loads((folder / "dataset.json").read_text())["state"]
    first, second = (np.load(io.BytesIO(sample["state.npy"])) for sample in samples(folder).values())
    place = {name: i for i, name in enumerate(names)}
    np.testing.assert_allclose([first[0, place["red.x"]], second[0, place["red.x"]]], [1, 2])
    assert np.isnan(first[:, place["green.x"]]).all()
    assert np.isnan(second[:, place["blue.x"]]).all()


def test_keys_have_no_dots_and_differ(make: Make) -> None:
    for name in ("a.b", "a b", "\u00e4" * 80):
        make(name, Span(0, 10))
    folder = exported(make("a_b", Span(0, 10)).parent, samples="episode")
    found = samples(folder)
    assert len(found) == 4
    assert all(key.isascii() and key.replace("_", "").isalnum() for key in found)
    assert {json.loads(sample["json"])["session"] for sample in found.values()} == {
        *("a.b", "a b", "a_b", "\u00e4" * 80)
    }


def test_a_file_is_at_most_as_large_as_allowed(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    from ecat.formats.datasets import webdataset

    monkeypatch.setattr(webdataset, "_MEGABYTE", 60_000)
    project = make("a", *(Span(10 * i, 10 * i + 10) for i in range(6)), film=True).parent
    folder = exported(project, samples="episode", shard_mb="1")
    paths = sorted(folder.glob("*.tar"))
    assert [path.name for path in paths] == [f"data-{i:06d}.tar" for i in range(len(paths))]
    assert len(paths) > 1
    assert all(path.stat().st_size <= 60_000 for path in paths)
    assert len(samples(folder)) == 6


def test_short_episodes_are_counted(make: Make, tmp_path: Path) -> None:
    project = make("a", GRASP, Span(45, 50)).parent
    report = formats.export(project, tmp_path / "out", format="webdataset", options={})
    assert "1 of 2 episodes are shorter than a window and have no sample" in report.findings
    with pytest.raises(InputError, match="cannot make samples"):
        exported(project, window_s="5")
    assert not project.with_name("dataset").exists()


def test_the_same_sessions_give_the_same_bytes(make: Make, tmp_path: Path) -> None:
    project = make("a", GRASP, film=True).parent
    for name in ("one", "two"):
        formats.export(project, tmp_path / name, format="webdataset")
    for name in ("data-000000.tar", "dataset.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    with tarfile.open(tmp_path / "one" / "data-000000.tar") as tar:
        assert {(m.mtime, m.uid, m.gid, m.uname, m.mode) for m in tar} == {(0, 0, 0, "", 0o644)}


# its loop over a loader's workers looks for them with a function that newer PyTorch calls old
@pytest.mark.filterwarnings("ignore")
def test_webdataset_reads_it(make: Make) -> None:
    pytest.importorskip("torch", exc_type=ImportError)
    wds = pytest.importorskip("webdataset", exc_type=ImportError)
    folder = exported(make("a", GRASP, film=True).parent, window_s="0.5", stride_s="0.25")
    data = wds.WebDataset(str(folder / "data-000000.tar"), shardshuffle=False).decode("rgb8")
    found = list(data.to_tuple("json", "state.npy", "color.000000.jpg"))
    assert [about["window"] for about, _, _ in found] == [0, 1]
    assert found[0][1].shape == (15, len(found[0][0]["state_names"]))
    assert found[1][2].shape == (48, 64, 3)
    assert found[1][2].mean() == pytest.approx(4 * 18, abs=3)
