"""Whether the slices of an FFV1 image are as they were written (RFC 9043 §4.9).

FFmpeg replaces a damaged slice by that of the image before without telling anyone; for measurements that is a lie.
"""

from __future__ import annotations

import zlib

_SIZE, _SUM = 3, 4
_FOOTER = _SIZE + 1 + _SUM
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_MASK = 0xFFFFFFFF


def slices_intact(packet: bytes) -> bool:
    """Whether ``packet`` is a row of slices that each end in their length, a status and a sum that is right.

    False also for images that were written without sums.
    """
    end = len(packet)
    while end > 0:
        if end < _FOOTER:
            return False
        start = end - _FOOTER - int.from_bytes(packet[end - _FOOTER : end - _FOOTER + _SIZE], "big")
        if start < 0 or _remainder(packet[start:end]) != 0:
            return False
        end = start
    return bool(packet)


def _remainder(data: bytes) -> int:
    """CRC-32 with the highest bit first and nothing inverted: zlib's of the bytes with their bits reversed."""
    return zlib.crc32(data.translate(_REVERSED), _MASK) ^ _MASK


class SliceGuard:
    """Looks at the packets of a stream one after the other.  A stream has sums if any of its packets has right ones."""

    def __init__(self) -> None:
        self._has_sums = False
        self._failed = False

    def damaged(self, packet: bytes) -> bool:
        """Whether this packet, or one before that could not be told yet, is damaged."""
        if not packet:
            return False
        if slices_intact(packet):
            self._has_sums = True
        else:
            self._failed = True
        return self._has_sums and self._failed
