"""Find benchmarks, run one, judge its metrics against its targets."""

from __future__ import annotations

import ast
import importlib
import os
import platform
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
ALONE = ("soak",)
"""Those that `all` leaves out, because the Makefile has a target for each."""


class Absent(Exception):  # noqa: N818 - an outcome, not an error
    """What the benchmark needs is not on this machine."""


def names() -> list[str]:
    """Return the names of all benchmarks, sorted."""
    return sorted(path.stem for path in FOLDER.glob("*.py") if not path.stem.startswith("_"))


def summary(name: str) -> str:
    """Return the first line of the benchmark's docstring without importing it."""
    docstring = ast.get_docstring(ast.parse((FOLDER / f"{name}.py").read_text(encoding="utf-8"))) or ""
    return docstring.partition("\n")[0]


def run(name: str) -> dict[str, Any]:
    """Run one benchmark; `passed` is None where it is absent, with the reason under `absent`."""
    result: dict[str, Any] = {
        "name": name,
        "metrics": {},
        "targets": {},
        "passed": None,
        "machine": machine(),
    }
    try:
        outcome = importlib.import_module(f"benchmarks.{name}").run()
    except Absent as reason:
        return result | {"absent": str(reason)}
    metrics, targets = outcome["metrics"], outcome["targets"]
    unknown = sorted(set(targets) - set(metrics))
    if unknown:
        raise KeyError(f"benchmark {name}: targets without a metric: {', '.join(unknown)}")
    passed = all(meets(metrics[metric], target) for metric, target in targets.items())
    more = {key: outcome[key] for key in ("peers", "tables") if key in outcome}
    return result | {"metrics": metrics, "targets": targets, "passed": passed} | more


def meets(value: float, target: dict[str, float]) -> bool:
    """Return whether a value lies within its target; NaN never does."""
    return target.get("min", float("-inf")) <= value <= target.get("max", float("inf"))


def machine() -> dict[str, Any]:
    """Describe the machine in the words that matter for speed."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or "unknown"
