"""``rerun my_session/``: the protocol between Rerun and its importers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import rerun as rr
from rerun.chunk import RrdReader

from ecat.store import Session
from ecat.view.importer import INCOMPATIBLE, main

COMMAND = [sys.executable, "-m", "ecat.view.importer"]


def test_rerun_and_ecat_agree_on_what_means_not_mine() -> None:
    assert INCOMPATIBLE == rr.EXTERNAL_IMPORTER_INCOMPATIBLE_EXIT_CODE


@pytest.mark.parametrize("inside", ["session.json", "tables/poses.parquet", "tables", "nothing here"])
def test_only_the_folder_of_a_session_is_taken(session: Session, inside: str) -> None:
    assert main([str(session.path / inside), "--application-id", "a", "--recording-id", "r"]) == INCOMPATIBLE


def test_a_folder_that_is_no_session_is_not_taken(tmp_path: Path) -> None:
    assert main([str(tmp_path)]) == INCOMPATIBLE


def test_the_session_goes_into_the_recording_that_rerun_names(session: Session, tmp_path: Path) -> None:
    options = [
        "--application-id",
        "viewer",
        "--recording-id",
        "load-7",
        "--opened-recording-id",
        "x",
        "--static",
    ]
    options += ["--time_sequence", "a=1", "--entity-path-prefix", "/p"]
    done = subprocess.run(
        [*COMMAND, str(session.path), *options], capture_output=True, check=True, timeout=60
    )
    file = tmp_path / "piped.rrd"
    file.write_bytes(done.stdout)
    (entry,) = RrdReader(file).recordings()
    assert (entry.application_id, entry.recording_id) == ("viewer", "load-7")
    assert "/world/boxes/Shell" in {chunk.entity_path for chunk in RrdReader(file).stream().to_chunks()}


def test_a_damaged_session_is_reported_without_a_traceback(session: Session) -> None:
    (session.path / "session.json").write_text("{", "utf-8")
    done = subprocess.run([*COMMAND, str(session.path)], capture_output=True, check=False, timeout=60)
    assert done.returncode == 1
    assert done.stdout == b""
    assert done.stderr.startswith(b"ecat: ")
    assert b"Traceback" not in done.stderr


def test_a_viewer_that_goes_away_ends_the_import(session: Session) -> None:
    process = subprocess.Popen([*COMMAND, str(session.path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(timeout=60) == 1
    assert process.stderr is not None
    with process.stderr as said:
        assert b"Traceback" not in said.read()


def test_saying_not_mine_loads_neither_rerun_nor_arrow(tmp_path: Path) -> None:
    script = (
        "import sys; from ecat.view.importer import main; main([sys.argv[1]]); "
        "sys.exit(bool({'rerun', 'pyarrow', 'numpy'} & set(sys.modules)))"
    )
    subprocess.run([sys.executable, "-c", script, str(tmp_path)], check=True, timeout=60)
