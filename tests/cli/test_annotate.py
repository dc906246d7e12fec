"""``ecat annotate``: an address, a page, and an end in order."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx
import pytest

from ecat.store import open_session

if TYPE_CHECKING:
    from conftest import Ecat


@contextmanager
def annotating(*options: object) -> Generator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """A process of ``ecat annotate --json``, and what it printed."""
    call = [sys.executable, "-m", "ecat", "annotate", "--json", "--port", "0", *map(str, options)]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        text = ""
        while not text.endswith("}\n"):
            line = process.stdout.readline()
            assert line, process.communicate()
            text += line
        try:
            yield process, json.loads(text)
        finally:
            process.kill()


def edit(said: dict[str, Any], name: str) -> httpx.Response:
    headers = {"authorization": f"Bearer {said['token']}"}
    body = {"author": "ben", "operations": [{"op": "add_event", "type": "wave", "segments": [[1, 5]]}]}
    url = f"{said['address']}/api/sessions/{name}/layers/main/operations"
    return httpx.post(url, json=body, headers=headers, timeout=30)


def test_ctrl_c_saves_and_ends(session: Path) -> None:
    with annotating(session, "--author", "ben") as (process, said):
        assert said["ok"] is True
        answer = httpx.get(said["url"])
        assert answer.status_code == 303
        assert edit(said, session.name).status_code == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""
    assert [event.type for event in open_session(session).layer().events][-1] == "wave"


def test_what_was_acknowledged_survives_being_killed(session: Path) -> None:
    with annotating(session) as (process, said):
        assert edit(said, session.name).status_code == 200
        process.kill()
        process.wait(30)
    assert [event.type for event in open_session(session).layer().events][-1] == "wave"


def test_the_page_is_told_who_annotates_which_layer(session: Path) -> None:
    with (
        annotating(session, "--author", "ben", "--layer", "second") as (_, said),
        httpx.Client(base_url=said["address"], timeout=30) as browser,
    ):
        assert browser.get(f"/?token={said['token']}").status_code == 303
        project = browser.get("/api/project").json()
    assert (project["author"], project["layer"]) == ("ben", "second")


def test_listening_elsewhere_says_what_that_means(session: Path) -> None:
    with annotating(session, "--host", "0.0.0.0") as (process, said):
        assert said["address"].startswith("http://127.0.0.1:")
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    assert "not only for this machine" in err
    assert "ssh -L" in err


def test_for_a_person_the_address_is_printed_and_the_next_one_when_it_was_used(session: Path) -> None:
    call = [sys.executable, "-m", "ecat", "annotate", str(session), "--port", "0", "--no-browser"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        url = first.split()[-1]
        assert url.startswith("http://127.0.0.1:")
        assert "Ctrl-C" in process.stdout.readline()
        assert httpx.get(url).status_code == 303
        other = process.stdout.readline().split()[-1]
        assert other != url
        assert httpx.get(url).status_code == 403
        assert httpx.get(other).status_code == 303
        process.send_signal(signal.SIGINT)
        assert "saved" in process.communicate(timeout=30)[0]


def test_what_cannot_be_annotated_is_refused(ecat: Ecat, tmp_path: Path) -> None:
    assert ecat("annotate", tmp_path / "nothing").code == 1
    assert ecat("annotate", tmp_path).code == 1
    (tmp_path / "file").write_text("")
    assert ecat("annotate", tmp_path / "file").code == 1


def test_only_whoever_annotates_waits_for_the_server_to_load() -> None:
    code = "import sys, ecat.cli.annotate; sys.exit({'fastapi', 'uvicorn', 'starlette'} & set(sys.modules) != set())"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("port", ["-1", "65536", "x"])
def test_a_port_is_a_number_that_ports_have(ecat: Ecat, session: Path, port: str) -> None:
    assert ecat("annotate", session, "--port", port).code == 2
