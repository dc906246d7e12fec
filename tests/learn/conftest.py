"""The command line, as for the verbs of ecat itself."""

from __future__ import annotations

from tests.command_line import Ecat, Result, ecat

__all__ = ["Ecat", "Result", "ecat"]
