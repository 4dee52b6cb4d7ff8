"""Input files together with what they do not say themselves. Importing this loads no solver."""

from __future__ import annotations

from dataclasses import dataclass

from ibfctl.surface.influence import InfluenceFunction
from ibfctl.surface.map import SurfaceMap
from ibfctl.surface.readers import read_influence, read_map


@dataclass(frozen=True)
class MapFile:
    """A map's file, and what the file itself does not say."""

    path: str
    pixel_mm: float | None = None
    unit: str | None = None
    array: str | None = None

    def read(self) -> SurfaceMap:
        """Read the map."""
        return read_map(self.path, pixel_mm=self.pixel_mm, height_unit=self.unit, array=self.array)


@dataclass(frozen=True)
class InfluenceFile:
    """An influence function's file or formula, and what it does not say itself."""

    spec: str
    pixel_mm: float | None = None
    unit: str | None = None

    def read(self) -> InfluenceFunction:
        """Read the influence function."""
        return read_influence(self.spec, pixel_mm=self.pixel_mm, rate_unit=self.unit)
