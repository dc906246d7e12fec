"""Networks need PyTorch, which comes with the extra ``learn`` and not with ``test``."""

from __future__ import annotations

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("torch") else ["test_*.py"]
