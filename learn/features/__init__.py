"""What learners are fed: features of sessions, declared by name and computed from tracks of points and boxes."""

from __future__ import annotations

__all__: list[str] = []
