"""Moments as arrays, and windows of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from ecat import formats
from ecat.errors import InputError
from ecat.formats.datasets.images import PLANES, decode_image
from ecat.store import open_session
from ecat.store.media import open_images
from tests.formats.datasets.moments import Make, Span

GRASP = Span(10, 40, parts=(("grasp", 10, 20), ("hold", 15, 40), ("move", 20, 35)))


def exported(path: Path, **options: str) -> Path:
    dest = path.with_name("dataset")
    formats.export(path, dest, format="torch", options=options)
    return dest


def load(folder: Path, name: str) -> Any:
    return np.load(folder / f"{name}.npy", allow_pickle=False)


def decoded(jpeg: bytes) -> Any:
    import cv2

    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)


def about(folder: Path) -> Any:
    return json.loads((folder / "dataset.json").read_text())


def test_a_row_is_a_moment_of_an_episode(make: Make) -> None:
    folder = exported(make("a", GRASP, Span(45, 55, "push")).parent)
    said = about(folder)
    assert (said["rows"], said["episodes"]) == (40, 2)
    assert said["state"][:3] == ["blue.x", "blue.y", "blue.z"]
    state = load(folder, "state")
    np.testing.assert_allclose(state[:, 0], 1 + np.r_[10:40, 45:55] / 1000, atol=1e-6)
    assert load(folder, "t_ns")[0] == 333_333_333
    # the next pose of the box that the event moves
    np.testing.assert_allclose(load(folder, "action")[:29, 0], state[1:30, 0])


def test_labels_are_those_of_the_event_and_of_its_innermost_part(make: Make) -> None:
    folder = exported(make("a", GRASP, Span(45, 55, "push")).parent)
    said = about(folder)
    label, part = load(folder, "label"), load(folder, "part")
    assert [said["labels"][i] for i in label[[0, 29, 30]]] == ["slide", "slide", "push"]
    names = np.array([*said["parts"], "nothing"])[part]
    assert list(names[[0, 4, 5, 10, 24, 25, 29, 30]]) == [
        *("grasp", "grasp", "hold", "move", "move", "hold", "hold", "nothing"),
    ]  # fmt: skip


def test_sessions_with_other_boxes_share_the_columns_that_have_the_same_name(make: Make) -> None:
    make("a", Span(0, 10), number=1)
    folder = exported(make("b", Span(0, 10, "push"), number=2, boxes=("green", "red")).parent)
    said = about(folder)
    assert said["labels"] == ["slide", "push"]
    place = {name: i for i, name in enumerate(said["state"])}
    state = load(folder, "state")
    np.testing.assert_allclose(state[[0, 10], place["red.x"]], [1, 2])
    np.testing.assert_array_equal(np.isnan(state[[0, 10], place["blue.x"]]), [False, True])
    np.testing.assert_array_equal(np.isnan(state[[0, 10], place["green.x"]]), [True, False])
    rows = pq.read_table(folder / "episodes.parquet").to_pylist()
    assert [(r["episode"], r["session"], r["label"], r["first_row"], r["rows"]) for r in rows] == [
        (0, "a", "slide", 0, 10),
        (1, "b", "push", 10, 10),
    ]


def test_each_moment_has_its_image(make: Make) -> None:
    make("a", Span(0, 5))
    folder = exported(make("b", Span(10, 20), film=True).parent)
    assert about(folder)["streams"] == ["color"]
    offsets = load(folder, "images/color")
    blob = (folder / "images" / "color.bin").read_bytes()
    assert len(offsets) == 16
    # the first session has no images
    assert offsets[5] == 0
    gray = [
        float(np.mean(decoded(blob[a:b])))
        for a, b in zip(offsets[5:-1].astype(int), offsets[6:].astype(int), strict=True)
    ]
    np.testing.assert_allclose(gray, 4 * np.arange(10, 20), atol=3)


def test_images_are_made_as_large_as_asked_or_left_out(make: Make) -> None:
    project = make("a", Span(0, 5), film=True).parent
    folder = exported(project, height="24")
    offsets = load(folder, "images/color").astype(int)
    data = (folder / "images" / "color.bin").read_bytes()[: offsets[1]]
    assert decoded(data).shape == (24, 32, 3)
    formats.export(project, project.with_name("without"), format="torch", options={"images": "none"})
    assert list((project.with_name("without") / "images").iterdir()) == []


def test_raw_images_are_those_of_the_recording(make: Make) -> None:
    path = make("a", Span(0, 5), film=True)
    folder = exported(path.parent, images="raw", height="")
    data = np.fromfile(folder / "images" / "color.bin", np.uint8)
    offsets = load(folder, "images/color").astype(int)
    with open_images(open_session(path), "color") as images:
        for moment, image in enumerate(images.read(range(5))):
            planes = decode_image(data[offsets[moment] : offsets[moment + 1]])
            assert planes is not None
            np.testing.assert_array_equal(planes.transpose(1, 2, 0)[:, :, ::-1], image)


def test_bytes_that_are_no_image_are_none() -> None:
    for data in (
        b"",
        b"R",
        PLANES,
        PLANES + b"\2\0\2\0" + bytes(11),
        PLANES + b"\2\0\2\0" + bytes(13),
        b"jpeg",
    ):
        assert decode_image(np.frombuffer(data, np.uint8)) is None


def test_the_same_sessions_give_the_same_bytes(make: Make, tmp_path: Path) -> None:
    project = make("a", GRASP, film=True).parent
    for name in ("one", "two"):
        formats.export(project, tmp_path / name, format="torch")
    files = [p.relative_to(tmp_path / "one") for p in (tmp_path / "one").rglob("*") if p.is_file()]
    assert len(files) == 9
    assert all((tmp_path / "one" / f).read_bytes() == (tmp_path / "two" / f).read_bytes() for f in files)


def test_how_the_clock_was_made_is_recorded(make: Make) -> None:
    folder = exported(make("a", GRASP).parent, fps="10", clock="linear")
    said = about(folder)
    assert said["clock"]["method"] == "linear"
    assert (said["clock"]["fps"], said["rows"]) == (10, 10)
    assert said["options"]["fps"] == 10


def test_without_events_there_is_nothing_to_export(make: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        formats.export(make("a"), tmp_path / "out", format="torch")
    assert not (tmp_path / "out").exists()
