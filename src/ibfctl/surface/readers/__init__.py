"""One reader per file format; `read_map` and `read_influence` choose by the file's suffix.

Units are never guessed: what a file does not say must be given, and what is given must not contradict
the file.
"""

from ibfctl.surface.readers.read import MAP_SUFFIXES, read_influence, read_map

__all__ = ["MAP_SUFFIXES", "read_influence", "read_map"]
