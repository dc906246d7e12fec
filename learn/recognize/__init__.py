"""Recognition of actions: who does what to which box, in each window of a session.

``dataset`` reads labelled sessions, ``model`` is the recogniser, ``evaluation`` says how good it is on sessions that
it was not trained on, whose choice is written down in ``folds``.
"""

from __future__ import annotations

__all__: list[str] = []
