"""Whole projects exported by the command line from and to an S3-compatible store, over HTTP."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from ecat.batch import export_sessions
from ecat.cli import main
from ecat.errors import DiskError, ExistsError, NotFoundError
from ecat.store import remote
from tests.store import test_remote
from tests.store.sessions import make

s3 = test_remote.s3
FORMATS = ["parquet", "csv"]


def tree(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lab") / "project"
    for number in range(2):
        make(folder / "day" / f"s{number}", number)
    return folder


@pytest.fixture(scope="module")
def bucket(s3: str, project: Path) -> str:
    remote.send(project, f"{s3}/project")
    return s3


def ecat(*arguments: object) -> int:
    return main([*map(str, arguments), "-q"])


@pytest.mark.parametrize("name", FORMATS)
def test_a_project_is_exported_to_a_bucket_and_from_one(
    bucket: str, project: Path, tmp_path: Path, name: str
) -> None:
    here, there, back = tmp_path / "here", f"{bucket}/{name}/there", tmp_path / "back"
    assert ecat("export", project, here, "--format", name) == 0
    assert ecat("export", f"{bucket}/project", there, "--format", name) == 0
    assert ecat("export", f"{bucket}/project", back, "--format", name) == 0
    remote.fetch(there, tmp_path / "fetched")
    assert tree(tmp_path / "fetched") == tree(here) == tree(back)
    assert remote.read(f"{there}.parts") is None
    if name == "parquet":
        sessions = pq.read_table(here / "tables" / "events.parquet")["session"].to_pylist()
        assert sessions == ["day/s0", "day/s1"]


@pytest.mark.parametrize("name", FORMATS)
def test_shares_wait_in_the_bucket_to_be_joined(
    bucket: str, project: Path, tmp_path: Path, name: str
) -> None:
    source, dest = f"{bucket}/project", f"{bucket}/{name}/shared"
    for share in ("2/2", "1/2"):
        assert ecat("export", source, dest, "--format", name, "--shard", share) == 0
        assert remote.read(f"{dest}/README.md") is None
    assert ecat("export", source, dest, "--format", name) == 0
    assert ecat("export", project, tmp_path / "here", "--format", name) == 0
    remote.fetch(dest, tmp_path / "back")
    assert tree(tmp_path / "back") == tree(tmp_path / "here")


def test_a_destination_that_is_taken_is_left_as_it_is(bucket: str, project: Path) -> None:
    url = f"{bucket}/taken"
    with remote.sent(f"{url}/file") as path:
        path.write_text("precious")
    with pytest.raises(ExistsError, match="cannot write"):
        export_sessions(project, url, format="parquet")
    assert remote.read(f"{url}/file") == b"precious"


@pytest.mark.usefixtures("s3")
def test_a_bucket_that_is_not_there_is_said(project: Path) -> None:
    with pytest.raises(NotFoundError, match="no-such-bucket"):
        export_sessions("s3://no-such-bucket/x", "s3://no-such-bucket/y", format="parquet")
    with pytest.raises(NotFoundError, match="there is no bucket no-such-bucket"):
        export_sessions(project, "s3://no-such-bucket/y", format="parquet")
    # and none was made
    assert remote.read("s3://no-such-bucket/y/README.md") is None
    with pytest.raises(NotFoundError, match="there is no bucket"):
        remote.send(project, "s3://no-such-bucket/z")


def test_a_store_that_does_not_answer_is_said(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    s3fs = pytest.importorskip("s3fs", reason="s3fs is not installed: pip install 'ecat[remote]'")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    # where a store is was kept with the one before
    s3fs.S3FileSystem.clear_instance_cache()
    for path, dest in ((project, "s3://silent/y"), ("s3://silent/x", tmp_path / "out")):
        with pytest.raises(DiskError, match=r"127\.0\.0\.1:9") as caught:
            export_sessions(path, dest, format="parquet")
        assert "the network" in caught.value.fix
    s3fs.S3FileSystem.clear_instance_cache()
    assert list(tmp_path.iterdir()) == []


def test_the_memory_of_a_command_is_no_place_to_write_to(
    project: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ecat("export", project, "memory://lab/out", "--format", "csv") == 2
    assert "gone when the command ends" in capsys.readouterr().err
