"""The text of `MG`: values, strings and formats."""

from __future__ import annotations

import re

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.expressions import Values, evaluate

_FORMAT = re.compile(r"\{([ZF])(\d{1,2})\.(\d{1,2})\}")
_CHARACTER = re.compile(r"\{\^(\d{1,3})\}")
_PORT = re.compile(r"\{(?:P\d|E([A-H]))\}")

NO_LINE_END = "{N}"


def message(text: str, values: Values, *, leading_blank: bool) -> str:
    """Text that `MG` followed by `text` prints.

    Raises
    ------
    CommandError
        52 or 53 for unbalanced quotes or braces, and what `evaluate` raises.
    """
    text = _PORT.sub("", text).replace(NO_LINE_END, "")
    parts = [_item(item.strip(), values) for item in _items(text) if item.strip()]
    if not parts:
        raise CommandError(errors.TOO_FEW_FIELDS)
    line, after_value = "", False
    for part, is_value in parts:
        blank = is_value and (after_value or (leading_blank and not part.startswith("-")))
        line += f" {part}" if blank else part
        after_value = is_value
    return line


def target(text: str) -> str | None:
    """Letter of the Ethernet handle that `{EA}` to `{EH}` in a message chooses, None if it chooses none."""
    found = _PORT.search(text)
    return None if found is None or found[1] is None else found[1]


def _items(text: str) -> list[str]:
    """Parts between commas that are not inside quotes, brackets or braces."""
    items, depth, quoted = [""], 0, False
    for character in text:
        if character == '"':
            quoted = not quoted
        elif not quoted:
            depth += (character in "([{") - (character in ")]}")
        if character == "," and depth == 0 and not quoted:
            items.append("")
        else:
            items[-1] += character
    if quoted:
        raise CommandError(errors.BAD_QUOTE)
    return items


def _item(item: str, values: Values) -> tuple[str, bool]:
    if item.startswith('"'):
        if not item.endswith('"') or item.count('"') != 2:
            raise CommandError(errors.BAD_QUOTE)
        return item[1:-1], False
    character = _CHARACTER.fullmatch(item)
    if character:
        return chr(int(character[1]) & 0xFF), False
    # The format may stand before the value or behind it.
    found = _FORMAT.search(item)
    expression = _FORMAT.sub("", item)
    if "{" in expression or "}" in expression:
        raise CommandError(errors.BAD_BRACES)
    value = evaluate(expression, values)
    if found is None:
        return f"{value:.4f}", True
    decimals = int(found[3])
    width = int(found[2]) + (decimals + 1 if decimals else 0)
    sign = "-" if value < 0 else ""
    number = f"{abs(value):.{decimals}f}"
    return sign + (number if found[1] == "Z" else number.rjust(width, "0")), True
