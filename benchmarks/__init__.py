"""Measured figures of the product: one module per benchmark, found by listing this folder.

A benchmark is a module whose name has no leading underscore, with a first docstring line that says what it
measures and a function ``run()`` that returns ``{"metrics": {name: value}, "targets": {name: {"max": x}}}``
(or ``{"min": x}``), units in the names of the metrics; ``"peers"``, where present, holds the figures of others.
Where what it needs is absent it raises `Absent`.
"""

from benchmarks._harness import Absent

__all__ = ["Absent"]
