"""Sets of features by name: the columns that they say, of sessions and of exports, and transforms fitted elsewhere."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from ecat.errors import EcatError, FormatError, InputError, NotFoundError, UsageError
from learn.features import ch4, ch5
from learn.features.recordings import Recording, read_session
from learn.features.sets import SETS, feature_set, features
from learn.features.transforms import KINDS, PcaPlanes, TablePlane, load_transform, save_transform
from learn.features.windows import VERSION, Table, window_features, windows_of
from tests.learn.features import sessions
from tests.learn.recognize import made

NAMES = {
    "ch4-raw": 63,
    "ch4-pcas18": 18,
    "ch4-qsr25": 25,
    "ch4-sparse522": 522,
    "ch4-event75": 75,
    "ch5-transforms": 15,
    "ch5-quantitative": 40,
    "ch5-qualitative": 13,
    "ch5-network": 7,
    "ch5-network-8": 8,
}
EXPORT = Recording("f/s", made.scene(1), None, None, ("Object_1", "Object_2"))
OTHER = Recording("f/t", made.scene(2, seed=4), None, None, ("Object_1", "Object_2"))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return read_session(sessions.make(tmp_path_factory.mktemp("s") / "slide", sessions.draft()))


def fitted(name: str) -> PcaPlanes | TablePlane | None:
    kind = SETS[name].transform
    return KINDS[kind].fit([OTHER]) if kind else None


def values(table: pa.Table) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.column_stack([table[name].to_numpy() for name in table.column_names[2:]])


@pytest.mark.parametrize("name", SETS)
def test_a_set_has_the_columns_that_it_says_of_sessions_and_of_exports(
    name: str, recording: Recording
) -> None:
    wanted = feature_set(name)
    assert len(wanted.columns()) == len(set(wanted.columns())) == NAMES.get(name, len(wanted.columns()))
    for one in (EXPORT, recording.filled()):
        table = features(one, wanted, fitted(name))
        assert table.column_names == ["session", "frame", *wanted.columns()]
        assert table.num_rows == (len(windows_of(one.points)) if wanted.per == "window" else len(one.points))
        assert table["frame"].to_pylist()[:3] == ([0, 5, 10] if wanted.per == "window" else [0, 1, 2])
        assert set(table["session"].to_pylist()) == {one.name}
        assert np.isfinite(values(table)).all()


def test_sets_are_called_what_models_say_that_they_see() -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'ecat[learn]'")
    from learn.features import raw
    from learn.recognize import sequence
    from learn.recognize.neural.recognizer import FEATURES

    assert {VERSION, sequence.FEATURES, *FEATURES.values()} - {raw.VERSION} <= set(SETS)


def test_the_page_lists_every_set() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "features.md").read_text("utf-8")
    for one in SETS.values():
        assert (
            f"| `{one.name}` | {len(one.columns())} | {one.per} | {one.inputs} | {one.source} | {one.what} |"
            in page
        )


def test_sets_equal_the_functions_that_they_are_made_of(recording: Recording) -> None:
    planes = PcaPlanes.fit([OTHER])
    places = ch4.pcas(EXPORT.points, planes.projections)
    assert (values(features(EXPORT, SETS["ch4-pcas18"], planes)) == places).all()
    assert (values(features(EXPORT, SETS["ch4-qsr25"], planes)) == ch4.qsr25(places)).all()
    assert recording.tracks is not None
    found = values(features(recording, SETS["ch5-qualitative"]))
    assert (found == ch5.qualitative(*ch5.by_salience(recording.tracks))).all()
    table = Table(made.SLOPE, made.HEIGHT)
    found = values(features(EXPORT, SETS[VERSION], TablePlane(table)))
    assert (found == window_features(windows_of(EXPORT.points), table)).all()


def test_frames_are_left_out_before_features_of_chapter_5_and_nowhere_else(recording: Recording) -> None:
    assert recording.tracks is not None
    table = features(recording, SETS["ch5-quantitative"], every=3)
    sampled = np.stack([ch5.subsampled(track, 3) for track in recording.tracks])
    assert (values(table) == ch5.quantitative(*ch5.by_salience(sampled))).all()
    assert table["frame"].to_pylist()[:3] == [0, 3, 6]
    with pytest.raises(UsageError, match="ch4-raw"):
        features(recording, SETS["ch4-raw"], every=3)
    with pytest.raises(InputError, match="ch5"):
        features(recording, SETS["ch5-quantitative"], every=10_000)


def test_gaps_are_null_in_measurements_and_refused_in_codes() -> None:
    points = EXPORT.points.copy()
    points[7, 11] = np.nan
    holes = replace(EXPORT, points=points)
    assert features(holes, SETS["ch4-raw"])["HandTipRight_x"].to_pylist()[6:9].count(None) == 1
    planes = PcaPlanes.fit([holes])
    assert features(holes, SETS["ch4-pcas18"], planes)["right_hand_y"].null_count == 1
    with pytest.raises(InputError) as error:
        features(holes, SETS["ch4-qsr25"], planes)
    assert "frame 7: right_hand" in error.value.where
    assert features(holes.filled(), SETS["ch4-qsr25"], planes).num_rows == len(points)


@pytest.mark.parametrize("name", SETS)
def test_a_recording_that_lacks_something_is_one_error_or_goes_without_it(name: str) -> None:
    unseen = EXPORT.points.copy()
    unseen[:, :13] = np.nan
    no_skeleton = replace(EXPORT, points=unseen)
    if SETS[name].inputs == "joints and markers":
        with pytest.raises(InputError) as error:
            features(no_skeleton, SETS[name], fitted(name))
        assert "no joints" in error.value.where
    else:
        assert features(no_skeleton, SETS[name], fitted(name)).num_rows
    short = replace(EXPORT, points=EXPORT.points[:19])
    if SETS[name].per == "window":
        with pytest.raises(InputError) as error:
            features(short, SETS[name], fitted(name))
        assert "19 frames" in error.value.where
    else:
        assert features(short, SETS[name], fitted(name)).num_rows == 19
    if SETS[name].transform:
        with pytest.raises(UsageError) as usage:
            features(EXPORT, SETS[name])
        assert "--fit" in usage.value.fix


def test_a_box_that_was_never_seen_has_no_track() -> None:
    points = EXPORT.points.copy()
    points[:, 17:] = np.nan
    with pytest.raises(InputError, match="follow a block"):
        features(replace(EXPORT, points=points), SETS["ch5-network"], fitted("ch5-network"))


def test_an_unknown_set_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UsageError) as error:
        feature_set("ch6")
    assert "ch5-quantitative" in error.value.where


# --- transforms


def test_a_transform_is_fitted_to_what_it_is_given_and_to_nothing_else() -> None:
    assert PcaPlanes.fit([OTHER]).numbers() != PcaPlanes.fit([EXPORT]).numbers()
    table = TablePlane.fit([OTHER]).table
    assert (table.slope, table.height) == pytest.approx((made.SLOPE, made.HEIGHT), abs=1e-3)


def test_boxes_are_where_they_were_put_on_the_table() -> None:
    tracks = TablePlane(Table(made.SLOPE, made.HEIGHT)).apply(EXPORT)
    across = EXPORT.points[:, 13:17, 0].mean(axis=1)
    assert tracks[0, :, 0] == pytest.approx(across)
    along = EXPORT.points[:, 13:17, 2].mean(axis=1) * np.hypot(1, made.SLOPE)
    shift = tracks[0, :, 1] - along
    assert shift == pytest.approx(np.full_like(shift, shift[0]))
    assert tracks[..., 2] == pytest.approx(np.zeros_like(tracks[..., 2]), abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_transform_survives_its_file(kind: str, tmp_path: Path) -> None:
    made_one = KINDS[kind].fit([OTHER])
    save_transform(made_one, tmp_path / "t.json")
    read = load_transform(tmp_path / "t.json", kind)
    assert (read.apply(EXPORT) == made_one.apply(EXPORT)).all()
    save_transform(made_one, tmp_path / "t.json")  # its own file is replaced
    (tmp_path / "notes.json").write_text("{}", "utf-8")
    with pytest.raises(EcatError, match=r"notes\.json"):
        save_transform(made_one, tmp_path / "notes.json")


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"[]",
        b"{}",
        b"\xff\xfe",
        b'{"transform": "table", "version": 1}',
        b'{"transform": "table", "version": 1, "slope": "x", "height": 1}',
        b'{"transform": "table", "version": 1, "slope": NaN, "height": 1}',
        b'{"transform": "table", "version": 1, "slope": 1e308, "height": 1}',
        b'{"transform": ["table"], "version": 1, "slope": 0, "height": 1}',
        b'{"transform": "pca", "version": 1, "inter": {"mean": [1], "components": []}}',
        b"[" * 100_000,
    ],
)
def test_a_file_that_is_no_transform_is_one_error(text: bytes, tmp_path: Path) -> None:
    path = tmp_path / "t.json"
    path.write_bytes(text)
    with pytest.raises(FormatError, match=r"t\.json"):
        load_transform(path, "table")


def test_a_transform_of_another_kind_or_version_is_refused_by_name(tmp_path: Path) -> None:
    save_transform(PcaPlanes.fit([OTHER]), tmp_path / "t.json")
    with pytest.raises(InputError) as error:
        load_transform(tmp_path / "t.json", "table")
    assert "'pca'" in error.value.where
    (tmp_path / "new.json").write_text('{"transform": "table", "version": 2}', "utf-8")
    with pytest.raises(InputError) as error:
        load_transform(tmp_path / "new.json", "table")
    assert "version 2" in error.value.where
    with pytest.raises(NotFoundError):
        load_transform(tmp_path / "none.json", "table")
