"""Windows of episodes, in one process and in several."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ecat import formats
from ecat.errors import CorruptError, EcatError, NotFoundError, UsageError
from tests.formats.datasets.moments import Make, Span

torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ecat[learn]'")


@pytest.fixture
def folder(make: Make, tmp_path: Path) -> Path:
    """Episodes of 20, 7 and 12 moments; the last one with images."""
    make("a", Span(0, 20, "slide"), Span(30, 37, "push"))
    make("b", Span(40, 52, "slide"), number=2, film=True)
    return export(tmp_path)


def export(place: Path, **options: str) -> Path:
    dest = place / f"data{''.join(options.values())}"
    formats.export(place / "project", dest, format="torch", options=options)
    return dest


def windows(folder: Path | str, **more: Any) -> Any:
    from ecat.datasets import Windows

    return Windows(folder, **more)


def first_frames(found: Any) -> list[float]:
    return [round(float(sample["state"][0, 0]), 3) for sample in found]


def test_windows_lie_within_their_episodes(folder: Path) -> None:
    found = windows(folder, length=10, stride=5)
    assert first_frames(found) == [1.0, 1.005, 1.01, 2.04]
    assert found[0]["state"].shape == (10, len(found.state_names))
    assert found[0]["state"].dtype == torch.float32
    np.testing.assert_allclose(found[3]["state"][:, 0], 2.04 + np.arange(10) / 1000, atol=1e-5)
    assert [int(sample["episode"]) for sample in found] == [0, 0, 0, 2]
    assert all(bool(sample["valid"].all()) for sample in found)


def test_images_are_those_of_the_stream_whatever_its_name(make: Make, tmp_path: Path) -> None:
    names = ("front", "front.left", "up/down")
    make("a", Span(10, 30), film=True, streams=names)
    make("b", Span(10, 30), film=True, streams=("front.left",))
    found = windows(export(tmp_path), length=1, stride=20, images=names)
    assert [bool(found[0][f"images.{name}"].any()) for name in names] == [True, True, True]
    assert [bool(found[1][f"images.{name}"].any()) for name in names] == [False, True, False]


def test_short_episodes_and_rests_are_filled_up_if_wanted(folder: Path) -> None:
    found = windows(folder, length=10, stride=10, short="pad")
    assert [int(sample["valid"].sum()) for sample in found] == [10, 10, 7, 10, 2]
    short = found[2]
    np.testing.assert_allclose(short["state"][6:, 0], 1.036, atol=1e-5)
    assert found.labels[int(short["label"])] == "push"


def test_times_count_from_the_episode_s_start(folder: Path) -> None:
    np.testing.assert_allclose(
        windows(folder, length=4, stride=4)[1]["time_s"], np.arange(4, 8) / 30, atol=1e-6
    )


def test_what_is_not_known_is_said_and_is_never_a_number_that_is_none(make: Make, tmp_path: Path) -> None:
    make("a", Span(0, 20))
    project = make("b", Span(0, 20), boxes=("red",)).parent
    formats.export(project, tmp_path / "data", format="torch")
    found = windows(tmp_path / "data", length=20)
    blue = found.state_names.index("blue.x")
    assert bool(found[0]["state_known"][:, blue].all())
    assert not bool(found[1]["state_known"][:, blue].any())
    assert bool(torch.isfinite(found[1]["state"]).all())


def test_images_come_as_red_green_blue_and_are_black_where_there_is_none(folder: Path) -> None:
    found = windows(folder, length=5, stride=5, images=["color"])
    assert found[0]["images.color"].shape == (1, 3, 48, 64)
    assert int(found[0]["images.color"].max()) == 0
    last = found[len(found) - 2]["images.color"]
    assert abs(float(last.float().mean()) - 4 * 44) < 3
    every = windows(folder, length=5, stride=5, images=["color"], frames="all")[len(found) - 2]
    means = every["images.color"].float().mean((1, 2, 3))
    np.testing.assert_allclose(means, 4 * np.arange(40, 45), atol=3)


def test_raw_images_are_read_as_jpeg_ones_are(folder: Path) -> None:
    raw = export(folder.parent, images="raw")
    for frames in ("last", "all"):
        wanted = windows(folder, length=5, stride=5, images=["color"], frames=frames)
        found = windows(raw, length=5, stride=5, images=["color"], frames=frames)
        assert len(found) == len(wanted)
        for one, other in zip(found, wanted, strict=True):
            assert one["images.color"].shape == other["images.color"].shape
            assert one["images.color"].is_contiguous()
            difference = one["images.color"].int() - other["images.color"].int()
            assert int(difference.abs().max()) <= 3


def test_episodes_can_be_chosen_and_samples_changed(folder: Path) -> None:
    found = windows(
        folder,
        length=5,
        where=lambda row: row["session"] == "b",
        transform=lambda sample: {"x": sample["state"][:, 0]},
    )
    assert len(found) == 8
    assert set(found[0]) == {"x"}
    assert len(windows(folder, length=5, where=lambda row: False)) == 0


def test_the_ends_of_the_list_are_where_they_should_be(folder: Path) -> None:
    found = windows(folder, length=10)
    assert float(found[-1]["state"][0, 0]) == float(found[len(found) - 1]["state"][0, 0])
    for index in (len(found), -len(found) - 1):
        with pytest.raises(IndexError):
            found[index]


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 2])
def test_a_loader_gives_every_window_once_shuffled_and_in_batches(folder: Path, workers: int) -> None:
    found = windows(folder, length=5, images=["color"])
    loader = torch.utils.data.DataLoader(
        found,
        batch_size=4,
        shuffle=True,
        num_workers=workers,
        multiprocessing_context="spawn" if workers else None,
        generator=torch.Generator().manual_seed(0),
    )
    batches = list(loader)
    assert batches[0]["state"].shape == (4, 5, len(found.state_names))
    seen = sorted(round(float(x), 3) for batch in batches for x in batch["state"][:, 0, 0])
    assert seen == sorted(first_frames(found))
    assert seen != [round(float(x), 3) for batch in batches for x in batch["state"][:, 0, 0]]


def test_what_goes_to_another_process_is_small(folder: Path) -> None:
    found = windows(folder, length=5)
    assert len(pickle.dumps(found)) < 10_000
    again = pickle.loads(pickle.dumps(found))
    assert first_frames(again) == first_frames(found)


def test_a_folder_that_is_none_or_a_wish_that_cannot_be_says_what_to_do(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(NotFoundError) as nothing:
        windows(tmp_path)
    assert "--format torch" in nothing.value.fix
    with pytest.raises(UsageError) as wrong:
        windows(folder, length=0, stride=0, short="x", images=["depth"], frames="some")
    assert len(wrong.value.where.split("\n")) == 5


@pytest.mark.parametrize(
    "wish", [{"length": 2.5}, {"length": "3"}, {"length": True}, {"stride": 1.0}, {"stride": None}]
)
def test_lengths_are_whole_numbers(folder: Path, wish: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="expected a whole number"):
        windows(folder, **wish)
    assert len(windows(folder, length=np.int64(10), stride=np.int32(5))) == 4


def test_a_url_is_refused_as_one() -> None:
    with pytest.raises(UsageError, match="cannot open s3://lab/data") as caught:
        windows("s3://lab/data")
    assert "copy it" in caught.value.fix


def test_one_stream_is_a_list_of_one(folder: Path) -> None:
    with pytest.raises(UsageError, match="images is 'color', expected a list of names"):
        windows(folder, images="color")


@pytest.mark.parametrize(
    "name",
    ["dataset.json", "state.npy", "label.npy", "episodes.parquet", "images/color.npy", "images/color.bin"],
)
@pytest.mark.parametrize("damage", ["gone", "empty", "cut", "other"])
def test_a_damaged_data_set_is_one_error(folder: Path, name: str, damage: str) -> None:
    path = folder / name
    whole = path.read_bytes()
    if damage == "gone":
        path.unlink()
    else:
        path.write_bytes({"empty": b"", "cut": whole[: len(whole) // 2], "other": b"[1]" * 100}[damage])
    with pytest.raises(EcatError) as caught:  # noqa: PT012
        found = windows(folder, length=5, images=["color"])
        for sample in found:
            assert torch.isfinite(sample["state"]).all()
    assert caught.value.fix


def test_a_pickle_in_place_of_an_array_is_never_loaded(folder: Path) -> None:
    np.save(folder / "state.npy", np.array([{"a": 1}], object), allow_pickle=True)
    with pytest.raises(CorruptError, match="cannot read"):
        windows(folder)


def test_numbers_of_rows_that_do_not_fit_are_found(folder: Path) -> None:
    about = json.loads((folder / "dataset.json").read_text())
    (folder / "dataset.json").write_text(json.dumps(about | {"rows": about["rows"] + 1}))
    with pytest.raises(CorruptError, match="cannot open"):
        windows(folder)
