"""Text that a controller sends unasked, told from replies by bit 7 of its bytes (`CW 1`)."""

from __future__ import annotations

import logging
import re

LONGEST_BYTES = 65536

_MARKED = bytes(range(0x80, 0x100))
_PLAIN = bytes(range(0x80))
_UNMARK = bytes(byte & 0x7F for byte in range(0x100))

_log = logging.getLogger(__name__)


class MarkedText:
    """Takes marked bytes out of what was received, and logs them line by line.

    Parameters
    ----------
    name
        What the handle is for; it appears in the log.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._text = bytearray()

    def out_of(self, data: bytes) -> bytes:
        """Return what is left of `data` without it."""
        if data.isascii():
            return data
        self._text += data.translate(_UNMARK, _PLAIN)
        *lines, rest = re.split(rb"[\r\n]+", self._text)
        for line in filter(None, lines):
            _log.warning("%s: controller says: %s", self._name, line.decode("ascii", "replace"))
        self._text = bytearray(rest[-LONGEST_BYTES:])
        return data.translate(None, _MARKED)
