"""The Rerun view of a session: columns in, recording and blueprint out."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ecat.view.record import blueprint, log_session, recording, save_rrd
    from ecat.view.screenshot import take_screenshot
    from ecat.view.viewer import open_viewer

__all__ = ["blueprint", "log_session", "open_viewer", "recording", "save_rrd", "take_screenshot"]

_HOMES = {"open_viewer": "viewer", "take_screenshot": "screenshot"}


def __getattr__(name: str) -> Any:
    # loaded when asked for: Rerun starts the importer for every file that it opens, mostly to hear "not mine"
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES.get(name, 'record')}"), name)
