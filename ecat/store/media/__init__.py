"""Media files of a session: read image by image, and written.

Nothing here holds more than a few images at a time, and PyAV (FFmpeg) is imported when the first file is opened.
"""

from __future__ import annotations

from ecat.store.media.images import MILLIMETRE, StreamImages, annotated_stream, open_images
from ecat.store.media.writers import ColorWriter, DepthWriter, remux

__all__ = [
    "MILLIMETRE",
    "ColorWriter",
    "DepthWriter",
    "StreamImages",
    "annotated_stream",
    "open_images",
    "remux",
]
