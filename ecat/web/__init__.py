"""The annotation page's server: HTTP over ``annotate`` and ``store``, for this machine only unless told otherwise.

Everything that happens to a session happens through an editor or a stage; nothing here knows a rule of annotation.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ecat.web.serve import Server

__all__ = ["Server"]


def __getattr__(name: str) -> Any:
    # FastAPI takes half a second to load, which only those should pay who serve
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.serve"), name)
