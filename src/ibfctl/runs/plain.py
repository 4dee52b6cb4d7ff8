"""What is recorded or shown is plain JSON: no numbers that JSON does not know, none of numpy's."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


def plain(value: Any) -> Any:
    """Return `value` as JSON knows it; what is not finite becomes None, what is unknown its text."""
    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy's scalars and arrays
        return plain(value.tolist())
    return str(value)


def dump(value: Any) -> str:
    """Return `value` as one line of JSON."""
    return json.dumps(plain(value), separators=(",", ":"), allow_nan=False)
