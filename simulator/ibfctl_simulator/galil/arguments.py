"""The forms that arguments take: axis lists, `A=1`, `1,,2`, `?`."""

from __future__ import annotations

from collections.abc import Iterator

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError

AXIS_INDEX = {letter: index for index, letter in enumerate("ABCDEFGH")} | {
    letter: index for index, letter in enumerate("XYZW")
}


def axis_list(text: str, axes: int, missing_axis_error: int) -> list[int]:
    """Return the indices of the axes listed as `AB` or `A B`, in order; all if none is named."""
    letters = text.replace(" ", "").replace(",", "")
    if not letters:
        return list(range(axes))
    return [axis_index(letter, axes, missing_axis_error) for letter in letters]


def axis_index(letter: str, axes: int, missing_axis_error: int) -> int:
    """Return the index of an axis letter.

    Raises
    ------
    CommandError
        `missing_axis_error` if the controller has no such axis, 4 if it is no axis letter.
    """
    index = AXIS_INDEX.get(letter)
    if index is None:
        raise CommandError(errors.OPERAND)
    if index >= axes:
        raise CommandError(missing_axis_error)
    return index


def fields_by_axis(text: str, axes: int, missing_axis_error: int) -> Iterator[tuple[int, str]]:
    """Yield axis index and text of each given field of `A=1` or of `1,,2`.

    Raises
    ------
    CommandError
        50 if there is no field, 4 or `missing_axis_error` for an axis that does not exist.
    """
    text = text.strip()
    if not text:
        raise CommandError(errors.TOO_FEW_FIELDS)
    if len(text) > 1 and text[1:].lstrip().startswith("=") and text[0] in AXIS_INDEX:
        yield axis_index(text[0], axes, missing_axis_error), text.partition("=")[2].strip()
        return
    for index, part in enumerate(text.split(",")):
        if not part.strip():
            continue
        if index >= axes:
            raise CommandError(missing_axis_error)
        yield index, part.strip()


def integer(value: float, low: int, high: int) -> int:
    """Round to an integer within a range.

    Raises
    ------
    CommandError
        6 if it is outside.
    """
    if not low <= value <= high:
        raise CommandError(errors.OUT_OF_RANGE)
    return round(value)
