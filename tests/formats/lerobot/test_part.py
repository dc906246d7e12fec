"""A session as a LeRobot data set: layout, numbers, words, videos, and what is said about them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from ecat import formats
from ecat.errors import CorruptError, InputError, UsageError
from ecat.formats.lerobot.depth import codes
from tests.formats.lerobot.conftest import Export
from tests.formats.lerobot.recordings import Action, Recording, depth_mm, grey, make, pose

COLOR, DEPTH = "observation.images.color", "observation.images.depth"
ODD = Action(start=17, end=40, parts=(("hold", 20, 30),))
"""Does not begin with a key frame: those are 0, 15, 30, 45."""


def brightness(images: list[np.ndarray]) -> list[float]:
    """Of the lower right quarter of each image."""
    return [float(image[image.shape[0] // 2 :, image.shape[1] // 2 :].mean()) for image in images]


def test_the_layout_is_that_of_lerobot_itself(export: Export, shared: Path) -> None:
    """Compared with a data set that lerobot 0.4.4 wrote."""
    ours = export(Recording(), language="none")
    theirs = shared / "lerobot_reference"
    info = json.loads((theirs / "meta/info.json").read_bytes())
    assert list(ours.info) == list(info)
    for key in ("codebase_version", "chunks_size", "data_path", "video_path", "fps", "data_files_size_in_mb"):
        assert ours.info[key] == info[key]
    video = ours.info["features"][COLOR]
    assert list(video["info"]) == list(info["features"]["observation.images.rgb"]["info"])
    for key in ("timestamp", "frame_index", "episode_index", "index", "task_index"):
        assert ours.info["features"][key] == info["features"][key]

    reference = json.loads((theirs / "meta/stats.json").read_bytes())
    assert {key: set(value) for key, value in ours.stats.items() if key in reference} == {
        key: set(value) for key, value in reference.items() if key in ours.stats
    }
    assert np.shape(ours.stats[COLOR]["mean"]) == np.shape(reference["observation.images.rgb"]["mean"])


@pytest.mark.parametrize(
    "file", ["data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"]
)
def test_columns_have_the_types_that_lerobot_gives_them(export: Export, shared: Path, file: str) -> None:
    ours = pq.read_schema(export(Recording(), language="none").root / file)
    theirs = pq.read_schema(shared / "lerobot_reference" / file)
    names = [name.replace("images.rgb", "images.color") for name in theirs.names]
    assert [name for name in ours.names if name in names] == names
    for name, there in zip(names, theirs.names, strict=True):
        if name not in {"observation.state", "action"}:
            assert ours.field(name).type == theirs.field(there).type, name
    assert (ours.metadata or {}).keys() == (theirs.metadata or {}).keys()
    if b"huggingface" in (ours.metadata or {}):
        mine, reference = (
            json.loads(schema.metadata[b"huggingface"])["info"]["features"] for schema in (ours, theirs)
        )
        assert mine["timestamp"] == reference["timestamp"]
        assert mine["observation.state"]["_type"] == reference["observation.state"]["_type"]


def test_rows_hold_the_recorded_numbers_at_regular_times(export: Export) -> None:
    found = export(Recording())
    assert found.column("timestamp").tolist() == (np.arange(30) / 30).astype(np.float32).tolist()
    assert found.column("frame_index").tolist() == found.column("index").tolist() == list(range(30))
    expected = np.array([[*pose(15 + i, 0), *pose(15 + i, 1)] for i in range(30)])
    names = found.info["features"]["observation.state"]["names"]
    assert names == [
        f"{box}.{axis}" for box in ("blue", "red") for axis in ("x", "y", "z", "qx", "qy", "qz", "qw")
    ] + [
        "HandLeft.closed",
        "HandRight.closed",
    ]
    state = found.column("observation.state")
    assert state[:, 7:14] == pytest.approx(expected[:, :7], abs=1e-6)
    assert state[:, :7] == pytest.approx(expected[:, 7:], abs=1e-6)
    assert found.column("action") == pytest.approx(np.array([pose(16 + i, 0) for i in range(30)]), abs=1e-6)
    [episode] = found.episodes
    assert (episode["length"], episode["tasks"], episode["session"]) == (30, ["Slide red past blue"], "one")


def test_unknown_numbers_repeat_the_last_and_are_marked(export: Export) -> None:
    found = export(Recording(unknown=tuple(range(20, 40))), gap_s="0.02")
    state, known = found.column("observation.state"), found.column("state_known")
    red = found.info["features"]["observation.state"]["names"].index("red.x")
    assert known[:, red].tolist() == [float(not 20 <= f < 40) for f in range(15, 45)]
    assert np.isfinite(state).all()
    assert state[10, red] == pytest.approx(pose(19, 0)[0])


def test_video_is_copied_where_the_episode_begins_with_a_key_frame(export: Export, tmp_path: Path) -> None:
    found = export(Recording())
    assert found.how["video"][COLOR] == {"episodes_copied": 1, "episodes_encoded": 0, "why": {}}
    assert not [line for line in found.findings if "encoded" in line]
    recorded = _decoded(tmp_path / "project/one/media/color.mp4")[15:45]
    for ours, theirs in zip(found.images(COLOR), recorded, strict=True):
        assert (ours == theirs).all()


def test_video_is_encoded_anew_where_it_does_not_fit(export: Export) -> None:
    found = export(Recording(actions=(ODD,)), crf="10")
    assert found.how["video"][COLOR]["episodes_encoded"] == 1
    why = "the episode does not begin with a key frame of the recording"
    assert f"stream color: 1 episode was encoded anew: {why}" in found.findings
    assert brightness(found.images(COLOR)) == pytest.approx([grey(f) for f in range(17, 40)], abs=3)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"encode": "always"}, "it was asked for"),
        ({"size": "32x24"}, "it was asked for"),
        ({"fps": "40"}, "on the regular clock an image is shown twice, or none"),
        ({"fps": "15"}, "on the regular clock an image is shown twice, or none"),
    ],
)
def test_why_video_was_encoded_is_on_record(export: Export, options: dict[str, str], why: str) -> None:
    found = export(Recording(), **options)
    assert found.how["video"][COLOR]["why"] == {why: 1}
    fps = int(options.get("fps", "30"))
    shown = [round(15 + i * 30 / fps - 1e-6) for i in range(fps)]
    assert brightness(found.images(COLOR)) == pytest.approx([grey(f) for f in shown], abs=4)
    size = (24, 32) if "size" in options else (48, 64)
    assert tuple(found.info["features"][COLOR]["shape"]) == (*size, 3)
    assert found.images(COLOR)[0].shape == (*size, 3)


def test_images_of_an_odd_size_lose_their_last_row_and_column(export: Export) -> None:
    found = export(Recording(size=(65, 49)))
    # the recorder cut it already: what is recorded as 4:2:0 has even sides
    assert found.images(COLOR)[0].shape == (48, 64, 3)


def test_every_episode_begins_with_a_key_frame_at_its_time(export: Export) -> None:
    import av

    actions = tuple(Action(start=s, end=s + 11) for s in (0, 3, 15, 17, 30))
    found = export(Recording(actions=actions))
    assert found.how["video"][COLOR]["episodes_copied"] == 3
    for episode in found.episodes:
        at = f"videos/{COLOR}"
        path = found.info["video_path"].format(
            video_key=COLOR, chunk_index=episode[f"{at}/chunk_index"], file_index=episode[f"{at}/file_index"]
        )
        with av.open(str(found.root / path)) as container:
            packets = [p for p in container.demux(video=0) if p.size]
        first = round(episode[f"{at}/from_timestamp"] * 30)
        assert packets[first].is_keyframe
        assert [float((p.pts or 0) * p.time_base) for p in packets] == pytest.approx(
            np.arange(len(packets)) / 30
        )
        assert episode[f"{at}/to_timestamp"] - episode[f"{at}/from_timestamp"] == pytest.approx(11 / 30)


def test_depth_is_lossless_in_twelve_bits(export: Export) -> None:
    found = export(Recording(views=("color", "depth")))
    table = codes(0.001)
    for number, image in enumerate(found.images(DEPTH)):
        assert (image == table[depth_mm(15 + number)]).all()
    feature = found.info["features"][DEPTH]
    assert feature["shape"] == [30, 40, 1]
    assert (
        feature["info"]
        | {
            "is_depth_map": True,
            "depth_unit": "mm",
            "video.codec": "hevc",
            "video.pix_fmt": "gray12le",
            "video.depth_min": 0.01,
            "video.depth_max": 10.0,
            "video.shift": 3.5,
            "video.use_log": True,
        }
        == feature["info"]
    )
    low, high = np.ravel(found.stats[DEPTH]["min"])[0], np.ravel(found.stats[DEPTH]["max"])[0]
    # a pixel that is not known comes out as the nearest
    assert (low, high) == (pytest.approx(10), pytest.approx(int(depth_mm(30).max()), abs=2))


def test_depth_and_cameras_are_left_out_on_request(export: Export) -> None:
    recording = Recording(views=("color", "color2", "depth", "infrared"))
    all_of_them = export(recording)
    assert {key for key in all_of_them.info["features"] if "images" in key} == {
        COLOR,
        "observation.images.color2",
        DEPTH,
    }
    assert any(line.startswith("stream infrared: LeRobot has no place") for line in all_of_them.findings)
    few = export(recording, to="few", cameras="color2, depth", depth="none")
    assert [key for key in few.info["features"] if "images" in key] == ["observation.images.color2"]
    assert few.findings[0] == "stream depth: depth=none"


def test_a_stream_without_an_image_near_goes_on_with_the_one_before(export: Export) -> None:
    found = export(Recording(views=("color", "depth"), late_s=0.4), episodes="session", gap_s="0.1")
    assert "stream depth: at 9 moments the image before is shown, none was taken nearer" in found.findings
    images = found.images(DEPTH)
    assert (images[0] == codes(0.001)[depth_mm(0)]).all()
    assert len(images) == 60
    assert found.how["clock"]["worst_offset_s"]["depth"] < 0.11


def test_what_has_no_place_is_counted(export: Export) -> None:
    assert export(Recording()).findings == ("LeRobot has no place for: 4 roles",)


def test_sub_events_are_in_the_official_columns(export: Export) -> None:
    found = export(Recording())
    said: list[Any] = found.rows["language_persistent"].to_pylist()
    assert all(row == said[0] for row in said)
    assert [(entry["content"], round(entry["timestamp"] * 30)) for entry in said[0]] == [
        ("hold", 0),
        ("move", 7),
        ("hold", 11),
    ]
    assert {np.float32(entry["timestamp"]) for entry in said[0]} <= set(
        found.column("timestamp").astype(np.float32)
    )
    assert found.info["features"]["language_persistent"] == {"dtype": "language", "shape": [1], "names": None}


def test_sub_events_may_be_an_index_as_lerobot_0_4_reads_it(export: Export) -> None:
    found = export(Recording(), language="index", gaps="none")
    names = pq.read_table(found.root / "meta/subtasks.parquet").to_pandas()
    assert names.index.name == "subtask"
    each = [names.iloc[i].name for i in found.column("subtask_index")]
    assert each == [""] * 5 + ["hold"] * 2 + ["move"] * 4 + ["hold"] * 4 + [""] * 15
    assert "language_persistent" not in found.rows.column_names


def test_statistics_are_those_of_the_rows(export: Export) -> None:
    actions = (Action(start=0, end=20), Action(start=30, end=55, theme="o2", text="Slide blue"))
    found = export(Recording(actions=actions))
    for key in ("observation.state", "action", "timestamp", "index", "task_index"):
        values = found.column(key).reshape(45, -1).astype(float)
        said = found.stats[key]
        assert said["mean"] == pytest.approx(values.mean(axis=0), abs=1e-6)
        assert said["std"] == pytest.approx(values.std(axis=0), abs=1e-6)
        assert said["min"] == pytest.approx(values.min(axis=0), abs=1e-6)
        assert said["count"] == [45]
        step = np.ptp(values, axis=0) / 44 + 1e-9
        assert (np.abs(np.array(said["q50"]) - np.median(values, axis=0)) <= 2 * step).all()
        parts = [episode[f"stats/{key}/mean"] for episode in found.episodes]
        assert parts[1] == pytest.approx(values[20:].mean(axis=0), abs=1e-6)
    # a corner is blue, and key frames are looked at: 0, 30, 45
    assert np.ravel(found.stats[COLOR]["max"]) == pytest.approx([grey(45) / 255, grey(45) / 255, 1], abs=0.05)
    assert found.stats[COLOR]["count"] == [4]


def test_there_is_a_row_group_for_each_episode(export: Export) -> None:
    actions = (Action(start=0, end=20), Action(start=30, end=55))
    file = pq.ParquetFile(export(Recording(actions=actions)).root / "data/chunk-000/file-000.parquet")
    assert [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)] == [20, 25]


def test_a_whole_session_is_an_episode_copied_image_by_image(export: Export) -> None:
    found = export(Recording(rate_hz=29.93), episodes="session", clock="images")
    assert len(found.rows) == 60
    assert found.how["video"][COLOR]["episodes_copied"] == 1
    assert found.how["clock"]["method"] == "images"


def test_the_same_session_gives_the_same_bytes(export: Export) -> None:
    recording = Recording(views=("color", "depth"), actions=(ODD, Action(start=30, end=50)), joints=True)
    first, second = export(recording), export(recording, to="again")
    assert first.files() == second.files()


def test_a_session_without_anything_to_tell_is_refused(tmp_path: Path) -> None:
    session = make(tmp_path, Recording(views=(), tables=(), actions=(Action(start=3, end=9),)))
    with pytest.raises(InputError, match="cannot export one") as raised:
        formats.export(session.path, tmp_path / "out", format="lerobot")
    assert "neither poses nor joints nor videos" in raised.value.where
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": "640"}, "lerobot cannot be told size=640"),
        ({"size": "33x20"}, "lerobot cannot be told size=33x20"),
        ({"split": "session", "test_share": "0"}, "lerobot cannot split by session"),
    ],
)
def test_options_that_make_no_sense_are_usage_errors(
    tmp_path: Path, options: dict[str, str], message: str
) -> None:
    session = make(tmp_path, Recording(views=()))
    with pytest.raises(UsageError, match=message):
        formats.export(session.path, tmp_path / "out", format="lerobot", options=options)


def test_a_camera_that_is_not_there_is_named(tmp_path: Path) -> None:
    session = make(tmp_path, Recording())
    with pytest.raises(InputError, match="cannot export stream front") as raised:
        formats.export(session.path, tmp_path / "out", format="lerobot", options={"cameras": "front"})
    assert "color" in raised.value.where


@pytest.mark.parametrize("encode", ["when_needed", "always"])
def test_a_recording_that_breaks_off_is_one_typed_error(tmp_path: Path, encode: str) -> None:
    session = make(tmp_path, Recording(actions=(Action(start=30, end=60),)))
    film = session.stream_path("color")
    whole = film.read_bytes()
    # the index is at the end of the file; what is missing is in the middle
    film.write_bytes(whole[: len(whole) // 3] + bytes(len(whole) - len(whole) // 3))
    with pytest.raises((CorruptError, InputError), match="cannot"):
        formats.export(session.path, tmp_path / "out", format="lerobot", options={"encode": encode})
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("clock", "sentence"),
    [
        ("nearest", "those of the recorded frame nearest in time"),
        ("images", "each image of the annotated video"),
    ],
)
def test_the_card_says_how_the_data_were_made(export: Export, clock: str, sentence: str) -> None:
    found = export(Recording(views=("color", "depth")), clock=clock)
    text = (found.root / "README.md").read_text()
    assert "lerobot 0.6; for 0.4, export with `--option language=index`" in text
    assert text.startswith("---\ntask_categories:\n- robotics\n")
    assert "1 episodes of people handling objects, 30 moments at 30 Hz, 1 tasks" in text
    assert sentence in text
    assert "Depth has 12 bits" in text


def _decoded(path: Path) -> list[np.ndarray]:
    import av

    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
