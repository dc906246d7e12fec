"""Turns recordings of people handling objects into machine-learnable data.

    session = ecat.open_session("my_session")
    session.events.to_pandas()
    session.table("poses", start=10.0, end=40.0).to_arrow()

Every error that is raised on purpose is an :class:`EcatError`; :mod:`ecat.errors` has the tree.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ecat.errors import EcatError

if TYPE_CHECKING:
    from ecat.store import Project, Session, open_project, open_session

    __version__: str

__all__ = ["EcatError", "Project", "Session", "open_project", "open_session"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("ecat")
    # Arrow, pandas and the rest take half a second to import: only for those who open a session
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from ecat import store

    return getattr(store, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
