"""Data sets for training: the moments of episodes, as arrays, tables and shards."""

from __future__ import annotations
