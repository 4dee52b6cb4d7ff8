"""Conversions at the edges; inside everything is mm, s and nm."""

from __future__ import annotations

from typing import Final

NM_PER_M: Final = 1e9
MM_PER_M: Final = 1e3

LENGTH_IN_MM: Final = {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3, "µm": 1e-3, "nm": 1e-6}
HEIGHT_IN_NM: Final = {"m": 1e9, "mm": 1e6, "um": 1e3, "µm": 1e3, "nm": 1.0, "pm": 1e-3}
RATE_IN_NM_S: Final = {
    "m/s": 1e9, "um/s": 1e3, "µm/s": 1e3, "nm/s": 1.0, "nm/min": 1 / 60, "um/min": 1e3 / 60,
}  # fmt: skip
