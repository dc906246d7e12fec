"""``python -m ecat`` is ``ecat``."""

from __future__ import annotations

import sys

from ecat.cli import main

sys.exit(main())
