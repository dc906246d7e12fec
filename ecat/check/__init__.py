"""Examine sessions as a doctor does: what is wrong, where, how bad it is, and what can be done about it."""

from __future__ import annotations

from ecat.check.doctor import check, examine
from ecat.check.finding import Finding, Patient
from ecat.check.mend import Repairs, repair

__all__ = ["Finding", "Patient", "Repairs", "check", "examine", "repair"]
