"""The table of docs/results.md, made from the results in benchmarks/out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from benchmarks._harness import FOLDER, meets

OUT = FOLDER / "out"
RESULTS = FOLDER.parent / "docs" / "results.md"
BEGIN, END = "<!-- benchmarks: begin -->", "<!-- benchmarks: end -->"
_SIGNIFICANT_DIGITS = 4


def write_report() -> None:
    """Put the table of all stored results between the markers of docs/results.md."""
    results = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(OUT.glob("*.json"))]
    before, _, rest = RESULTS.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    RESULTS.write_text(f"{before}{BEGIN}\n{table(results)}{END}{after}", encoding="utf-8")


def store(result: dict[str, Any]) -> Path:
    """Write one result to benchmarks/out."""
    OUT.mkdir(exist_ok=True)
    path = OUT / f"{result['name']}.json"
    path.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return path


def table(results: list[dict[str, Any]]) -> str:
    """Return a Markdown table with one row per metric, the machines below it, and the tables of single benchmarks."""
    lines = ["| benchmark | metric | value | target | |", "| --- | --- | ---: | ---: | --- |"]
    for result in results:
        if "absent" in result:
            lines.append(f"| `{result['name']}` | | | | absent: {result['absent']} |")
        for metric, value in result["metrics"].items():
            target = result["targets"].get(metric, {})
            verdict = "" if not target else "reached" if meets(value, target) else "**missed**"
            lines.append(
                f"| `{result['name']}` | `{metric}` | {_number(value)} | {_bounds(target)} | {verdict} |"
            )
    machines = sorted({_machine(result["machine"]) for result in results})
    lines += ["", *(f"Measured on: {machine}." for machine in machines), ""]
    for result in results:
        for own in result.get("tables", []):
            lines += [f"`{result['name']}`:", "", *_rows(own["columns"], own["rows"]), ""]
    return "\n".join(lines)


def _rows(columns: list[str], rows: list[list[str]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (columns, ["---"] * len(columns), *rows)]


def _number(value: float) -> str:
    return f"{value:.{_SIGNIFICANT_DIGITS}g}" if isinstance(value, float) else str(value)


def _bounds(target: dict[str, float]) -> str:
    signs = {"min": "≥", "max": "≤"}
    return ", ".join(f"{signs[bound]} {_number(limit)}" for bound, limit in target.items())


def _machine(machine: dict[str, Any]) -> str:
    return (
        f"{machine['processor']}, {machine['cores']} cores, {machine['memory_gib']} GiB, "
        f"{machine['system']}, Python {machine['python']}"
    )
