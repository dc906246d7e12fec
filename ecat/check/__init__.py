"""Examine sessions as a doctor does: what is wrong, where, how bad it is, and what can be done about it."""

from __future__ import annotations

from ecat.check.doctor import check, examine, repair
from ecat.check.finding import Finding, Patient

__all__ = ["Finding", "Patient", "check", "examine", "repair"]
