"""Without PyTorch it is said what to install."""

from __future__ import annotations

import importlib
import importlib.util

import pytest

import learn.recognize.neural
from ecat.errors import MissingExtraError


def test_without_pytorch_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(name: str) -> None:
        del name

    monkeypatch.setattr(importlib.util, "find_spec", nothing)
    with pytest.raises(MissingExtraError, match="cannot use a neural") as error:
        importlib.reload(learn.recognize.neural)
    assert "ecat[learn]" in error.value.fix
