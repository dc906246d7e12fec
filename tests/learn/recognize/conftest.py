"""Pictures are looked at before they become files."""

from __future__ import annotations

from typing import Any

import pytest


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The figures that were saved, in order."""
    module = pytest.importorskip(
        "matplotlib.figure", reason="Matplotlib is not installed: pip install 'ecat[plots]'"
    )
    saved: list[Any] = []
    write = module.Figure.savefig

    def savefig(figure: Any, *arguments: Any, **options: Any) -> None:
        saved.append(figure)
        write(figure, *arguments, **options)

    monkeypatch.setattr(module.Figure, "savefig", savefig)
    return saved
