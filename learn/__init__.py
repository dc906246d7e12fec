"""What is learned from sessions: features, recognisers of actions, and policies that perform them.

The package stands on the public interface of :mod:`ecat`, as any other program would: it reads sessions,
tables and annotations through it and never opens the files of a session by itself.  In return, nothing in
:mod:`ecat` imports it, so that recording, annotating and checking need neither PyTorch nor a trained model.
PyTorch comes with the extra ``learn`` (``pip install ecat[learn]``).
"""

from __future__ import annotations

__all__: list[str] = []
