"""The viewer as a process, and the picture of it."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest

from ecat.errors import UsageError
from ecat.store import Session
from ecat.view import open_viewer
from ecat.view.screenshot import smaller
from ecat.view.viewer import SETTINGS, spawn_viewer


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_without_a_display_the_error_says_what_to_do(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(UsageError, match="no display") as raised:
        open_viewer(session)
    assert "--save" in raised.value.fix


def test_a_viewer_that_does_not_start_is_an_error() -> None:
    with pytest.raises(UsageError, match="ended with code"):
        spawn_viewer("--no-such-option")


def test_a_viewer_started_here_reports_to_nobody() -> None:
    told = subprocess.run(
        [sys.executable, "-m", "rerun_cli", "analytics", "config"],
        env={**os.environ, "XDG_CONFIG_HOME": str(SETTINGS)},
        capture_output=True,
        check=True,
        timeout=60,
    )
    assert json.loads(told.stdout)["analytics_enabled"] is False


def test_a_picture_is_reduced_and_loses_the_menu_bar() -> None:
    large = np.full((400, 600, 3), 255, np.uint8)
    large[:72] = 0
    picture = smaller(cv2.imencode(".png", large)[1].tobytes(), (300, 200))
    read = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    assert read is not None
    assert read.shape == (164, 300, 3)
    # there are fewer shades than 256
    assert (read > 249).all()
