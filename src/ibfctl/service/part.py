"""What the body of a plan says of the part: its clear aperture, and how it stands on the machine."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _number(value: object) -> object:
    if isinstance(value, bool | str):
        raise ValueError("give a number")
    return value


Count = Annotated[int, Field(ge=0), BeforeValidator(_number)]
Yes = Annotated[bool, Field(strict=True)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
"""Numbers are numbers: `false` is not taken for a place of 0 mm, nor a text for what it may mean."""


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid")


class CircularAperture(_Body):
    """A circle on the part."""

    circle: Annotated[tuple[Finite, Finite, Positive], Field(description="x, y and radius.")]


class PolygonalAperture(_Body):
    """A polygon on the part."""

    polygon: Annotated[list[tuple[Finite, Finite]], Field(min_length=3, max_length=10_000, description="Corners x, y.")]


class MaskedAperture(_Body):
    """A mask: where an uploaded map on the same pixels holds data."""

    mask_id: Annotated[str, Field(description="Id of that map.")]


class GivenPlacement(_Body):
    """Part to machine: x reversed where mirrored, then rotation, then offset."""

    offset_mm: Annotated[tuple[Finite, Finite], Field(description="Part's origin on the machine.")] = (0.0, 0.0)
    rotation_deg: Annotated[Finite, Field(description="Counterclockwise.")] = 0.0
    mirrored: Yes = False


class FiducialPlacement(_Body):
    """Offset and rotation fitted to pairs of positions."""

    fiducials_mm: Annotated[
        list[tuple[Finite, Finite, Finite, Finite]],
        Field(min_length=2, max_length=1000, description="Part x, y and machine x, y of each fiducial."),
    ]
    mirrored: Yes = False
    limit_mm: Annotated[Positive, Field(description="Largest error of a fiducial.")] = 0.05


Aperture = tuple[Finite, Finite, Finite, Finite] | CircularAperture | PolygonalAperture | MaskedAperture
Placing = GivenPlacement | FiducialPlacement
