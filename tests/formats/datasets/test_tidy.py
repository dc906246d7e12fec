"""Plain Parquet files, read by others."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
import yaml

from ecat import formats
from ecat.formats.datasets import tidy
from ecat.store import open_session
from ecat.tables import TABLES
from tests.formats.datasets.moments import Make, Span

GRASP = Span(10, 40, parts=(("grasp", 10, 20),))


def exported(path: Path, **options: str) -> Path:
    dest = path.with_name("dataset")
    formats.export(path, dest, format="parquet", options=options)
    return dest


def test_a_row_is_a_moment_with_columns_by_name(make: Make) -> None:
    make("a", GRASP)
    folder = exported(make("b", Span(0, 10, "push"), number=2, boxes=("red", "green")).parent)
    rows = pd.read_parquet(folder / "moments.parquet")
    assert len(rows) == 40
    np.testing.assert_allclose(rows["state.red.x"], [*(1 + np.r_[10:40] / 1000), *(2 + np.r_[:10] / 1000)])
    assert rows["state.green.x"].isna().tolist() == [True] * 30 + [False] * 10
    first = rows.iloc[0]
    assert (first["session"], first["episode"], first["moment"]) == ("a", 0, 0)
    assert (first["label"], first["task"], first["event"]) == ("slide", "slide 0", "e0")


@pytest.mark.parametrize(
    ("second", "n_gathered", "groups"), [(True, 1, 3), (True, 20, 2), (True, 35, 2), (False, 20, 2)]
)
def test_columns_that_come_after_the_first_row_group_are_those_of_all(
    make: Make, monkeypatch: pytest.MonkeyPatch, second: bool, n_gathered: int, groups: int
) -> None:
    """The rows are the same as with one row group; sessions of 30, 10 and 30 moments, the second with a second box,
    or the last, which finds rows gathered behind the first row group.
    """
    both = ("red", "green")
    make("a", GRASP)
    make("b", Span(0, 10, "push"), number=2, boxes=both if second else ("red",))
    project = make("c", GRASP, number=3, boxes=("red",) if second else both).parent
    expected = pq.read_table(exported(project, tables="no") / "moments.parquet")
    shutil.rmtree(project.with_name("dataset"))
    one_box = expected.select([name for name in expected.schema.names if ".green." not in name])
    monkeypatch.setattr(tidy, "_GATHERED_BYTES", one_box.nbytes * n_gathered // len(one_box))
    path = exported(project, tables="no") / "moments.parquet"
    assert pq.read_table(path).equals(expected, check_metadata=True)
    assert pq.read_metadata(path).num_row_groups == groups


def test_what_waits_to_be_written_is_bounded_in_all_files_together(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of files with few rows, which a bound for each file would not be reached by for long."""
    sessions = [make(f"s{number}", GRASP, number=number + 1) for number in range(9)]
    limit, most = 20_000, 0
    write_the_largest = tidy._write_the_largest  # pyright: ignore[reportPrivateUsage]

    def observed(outs: Any) -> None:
        nonlocal most
        write_the_largest(outs)
        most = max(most, sum(out.gathered_bytes for out in outs.values()))

    monkeypatch.setattr(tidy, "_write_the_largest", observed)
    monkeypatch.setattr(tidy, "_GATHERED_BYTES", limit)
    folder = exported(sessions[0].parent)
    assert 0 < most < limit
    sizes = {path.stem: pq.read_metadata(path) for path in folder.rglob("*.parquet")}
    assert sizes["poses"].num_row_groups > sizes["events"].num_row_groups


def test_windows_say_which_moments_they_are(make: Make) -> None:
    folder = exported(make("a", GRASP).parent, window_s="0.5", stride_s="0.2")
    windows = pd.read_parquet(folder / "windows.parquet")
    moments = pd.read_parquet(folder / "moments.parquet")
    assert windows["first_moment"].tolist() == [0, 6, 12]
    for window in windows.to_dict("records"):
        inside = moments[(moments["t_ns"] >= window["start_ns"]) & (moments["t_ns"] < window["end_ns"])]
        assert inside["moment"].tolist() == [window["first_moment"] + i for i in range(15)]


def test_episodes_that_are_shorter_than_a_window_are_counted(make: Make, tmp_path: Path) -> None:
    project = make("a", GRASP, Span(50, 55, "push")).parent
    report = formats.export(project, tmp_path / "some", format="parquet")
    assert "1 of 2 episodes are shorter than a window and have none" in report.findings
    fit = formats.export(project, tmp_path / "all", format="parquet", options={"window_s": "0.1"})
    assert not [said for said in fit.findings if "shorter" in said]


def test_tables_are_those_of_the_sessions_with_the_session_in_front(make: Make) -> None:
    make("a", GRASP)
    folder = exported(make("b", GRASP, number=2).parent)
    for name in ("events", "poses", "objects"):
        rows = pq.read_table(folder / "tables" / f"{name}.parquet")
        assert rows.schema.names == ["session", *TABLES[name].arrow.names]
        for session in "ab":
            own = open_session(folder.with_name("project") / session).table(name)
            mine = rows.filter(np.asarray(rows["session"].to_pylist()) == session)
            assert mine.num_rows == own.num_rows
            if name == "events":
                assert mine.drop(["session"]).to_pylist() == own.to_arrow().to_pylist()
    assert (rows.schema.field("name").metadata or {})[b"meaning"]


def test_the_card_names_every_file(make: Make) -> None:
    folder = exported(make("a", GRASP).parent)
    _, head, text = (folder / "README.md").read_text().split("---\n", 2)
    configs = yaml.safe_load(head)["configs"]
    files = {p.relative_to(folder).as_posix() for p in folder.rglob("*.parquet")}
    assert {config["data_files"] for config in configs} == files
    assert [config["config_name"] for config in configs if config.get("default")] == ["moments"]
    assert '"fps": 30' in text


def test_hugging_face_opens_it_by_the_card(make: Make, tmp_path: Path) -> None:
    datasets = pytest.importorskip("datasets", reason="Hugging Face datasets is not installed")
    folder = exported(make("a", GRASP).parent)
    for name in ("moments", "windows", "objects", "poses"):
        found = datasets.load_dataset(str(folder), name, split="train", cache_dir=str(tmp_path / "cache"))
        assert len(found) > 0


def test_duckdb_and_polars_open_it(make: Make) -> None:
    folder = exported(make("a", GRASP).parent)
    duckdb = pytest.importorskip("duckdb", reason="DuckDB is not installed")
    assert duckdb.sql(f"select count(*) from '{folder}/moments.parquet'").fetchall() == [(30,)]
    polars = pytest.importorskip("polars", reason="Polars is not installed")
    assert polars.read_parquet(folder / "tables" / "poses.parquet").height == 122


def test_a_session_without_events_still_has_its_tables(make: Make) -> None:
    report = formats.export(make("a"), make("b").parents[1] / "out", format="parquet")
    out = Path(report.path)
    assert report.findings[0].startswith("no moments")
    assert (out / "tables" / "poses.parquet").exists()
    assert not (out / "moments.parquet").exists()


def test_the_same_sessions_give_the_same_bytes_however_they_are_shared_out(
    make: Make, tmp_path: Path
) -> None:
    for name in "abc":
        make(name, GRASP)
    project = tmp_path / "project"
    formats.export(project, tmp_path / "one", format="parquet")
    formats.export(project, tmp_path / "two", format="parquet")
    for path in (p for p in (tmp_path / "one").rglob("*") if p.is_file()):
        assert path.read_bytes() == (tmp_path / "two" / path.relative_to(tmp_path / "one")).read_bytes()
