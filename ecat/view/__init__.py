"""The Rerun view of a session: columns in, recording and blueprint out."""

from __future__ import annotations

from ecat.view.record import blueprint, log_session, recording, save_rrd
from ecat.view.screenshot import take_screenshot
from ecat.view.viewer import open_viewer

__all__ = ["blueprint", "log_session", "open_viewer", "recording", "save_rrd", "take_screenshot"]
