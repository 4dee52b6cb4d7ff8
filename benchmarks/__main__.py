"""`python -m benchmarks list`, `run NAME [--json]`, `all [NAME ...]`, `report`."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from benchmarks import _harness as harness
from benchmarks import _report as report


def main() -> int:
    """Run the command line of the benchmarks; non-zero if a target was missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure the product.")
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("list", help="name every benchmark and what it measures")
    run = verbs.add_parser("run", help="run one benchmark")
    run.add_argument("name", choices=harness.names(), metavar="NAME")
    run.add_argument("--json", action="store_true", help="print one JSON object")
    every = verbs.add_parser(
        "all", help="run every benchmark, or those named, in its own process, write benchmarks/out/ and the report"
    )
    every.add_argument("names", nargs="*", metavar="NAME")
    verbs.add_parser("report", help="write the table of docs/results.md from benchmarks/out/")
    arguments = parser.parse_args()
    if arguments.verb == "list":
        for name in harness.names():
            print(f"{name:<20} {harness.summary(name)}")
        return 0
    if arguments.verb == "run":
        result = harness.run(arguments.name)
        print(json.dumps(result, indent=2) if arguments.json else _lines(result))
        return 1 if result["passed"] is False else 0
    if arguments.verb == "all":
        unknown = set(arguments.names) - set(harness.names())
        if unknown:
            parser.error(f"no such benchmark: {', '.join(sorted(unknown))}; see `list`")
        return _run_all(arguments.names or [name for name in harness.names() if name not in harness.ALONE])
    report.write_report()
    return 0


def _run_all(names: Sequence[str]) -> int:
    """Run each benchmark in a process of its own, so that none inherits another's memory or caches."""
    failed = []
    for name in names:
        child = subprocess.run(
            [sys.executable, "-m", "benchmarks", "run", name, "--json"],
            stdout=subprocess.PIPE,
            text=True,
            check=False,
        )
        if not child.stdout:
            failed.append(name)
            continue
        result = json.loads(child.stdout)
        report.store(result)
        print(_lines(result), flush=True)
        if result["passed"] is False:
            failed.append(name)
    report.write_report()
    if failed:
        print(f"missed or broken: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _lines(result: dict[str, Any]) -> str:
    state = {True: "passed", False: "MISSED", None: f"absent: {result.get('absent')}"}[result["passed"]]
    lines = [f"{result['name']}: {state}"]
    for metric, value in result["metrics"].items():
        target = result["targets"].get(metric)
        lines.append(f"  {metric} = {value:.6g}" + (f"  (target {target})" if target else ""))
    return "\n".join(lines)


sys.exit(main())
