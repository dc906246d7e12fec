"""``ecat demo`` and ``ecat calibrate``: the real thing, on the generated recordings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow.parquet as pq
import pytest

from ecat.cli import tour
from ecat.model.prototype import BoxPrototype
from ecat.store import open_session

if TYPE_CHECKING:
    from conftest import Ecat


@pytest.mark.slow
def test_the_demo_goes_all_the_way_and_may_be_repeated(ecat: Ecat, tmp_path: Path) -> None:
    made = [ecat("demo", tmp_path / "demo", "--json").json for _ in range(2)]
    assert made[0] == made[1]
    assert (made[0]["ok"], made[0]["identical"]) == (True, True)
    assert {finding["code"] for finding in made[0]["findings"]} == {"clock-unknown"}
    assert open_session(Path(made[0]["session"])).has_table("poses_smooth")
    assert pq.read_metadata(made[0]["poses"]).num_rows > 0
    assert Path(made[0]["recording"]).stat().st_size > 0
    filmed = open_session(Path(made[0]["video_session"]))
    assert filmed.poses.to_arrow()["source"].null_count < filmed.poses.num_rows / 10
    assert Path(made[0]["video_recording"]).stat().st_size > 0


def test_a_checkout_without_recordings_generates_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tour, "SHIPPED", tmp_path / "nowhere")
    source = tour._source(tmp_path / "recording")  # pyright: ignore[reportPrivateUsage]
    assert [path.name for path in source.rglob("files.param")] == ["files.param"]


def test_the_demo_leaves_alone_what_no_demo_made(ecat: Ecat, tmp_path: Path) -> None:
    (tmp_path / "project").mkdir()
    (tmp_path / "project" / "thesis.txt").write_text("years of work", "utf-8")
    result = ecat("demo", tmp_path)
    assert result.code == 1
    assert "there is something that no demo made" in result.err
    assert (tmp_path / "project" / "thesis.txt").read_text("utf-8") == "years of work"


def test_the_demo_notices_a_file_that_did_not_come_back(tmp_path: Path) -> None:
    for folder, names in (("source", "abc"), ("back", "ab")):
        (tmp_path / folder).mkdir()
        for name in names:
            (tmp_path / folder / name).write_text(name, "utf-8")
    (tmp_path / "back" / "b").write_text("B", "utf-8")
    different = tour._differences(tmp_path / "source", tmp_path / "back")  # pyright: ignore[reportPrivateUsage]
    assert list(different) == ["b", "c"]


@pytest.mark.slow
def test_calibrate_writes_what_process_takes(ecat: Ecat, session: Path, tmp_path: Path) -> None:
    file = tmp_path / "boxes.json"
    result = ecat("calibrate", session, "-o", file)
    assert result.code == 0
    assert [line.split("  ")[0] for line in result.out.splitlines()[:2]] == ["Shell", "Stella Artois"]
    boxes = json.loads(file.read_text("utf-8"))["boxes"]
    assert ecat("process", session, "--prototypes", file, "--stage", "plane", "--quiet").code == 0
    assert [dict(box) for box in open_session(session).manifest.prototypes] == boxes
    assert {BoxPrototype.from_dict(box).name for box in boxes} == {"Shell", "Stella Artois"}
