"""Machines, paths and dwell times of many kinds, for the scheduler's properties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st

from ibfctl.machine.description import MachineDescription
from ibfctl.path.maze import maze
from ibfctl.path.raster import raster
from ibfctl.path.tool_path import ToolPath
from ibfctl.surface.map import Rectangle

TRAVEL_MM = 200.0
KINDS = ("raster", "maze", "slanted walk", "grid walk", "spiral", "slanted line", "jittered line")
STAGES = ((250.0, 2000.0), (5.0, 50.0), (200.0, 100.0), (20.0, 20_000.0), (1.0, 5.0))
PERIODS_S = (1 / 1024, 1e-3, 1 / 4096)
SCALES = (100.0, 1000.0, 3276.8, 10_000.0, 1e6)


@dataclass(frozen=True)
class Job:
    kind: str
    path: ToolPath
    dwell_s: np.ndarray
    machine: MachineDescription
    corridor_mm: float


def make_machine(
    *,
    counts_per_mm: tuple[float, float] = (10_000.0, 10_000.0),
    direction: tuple[int, int] = (1, 1),
    letters: str = "AB",
    v_max_mm_s: tuple[float, float] = (250.0, 150.0),
    a_max_mm_s2: tuple[float, float] = (2000.0, 1000.0),
    j_max_mm_s3: float | None = None,
    sample_period_s: float = 1 / 1024,
    travel_mm: float = TRAVEL_MM,
) -> MachineDescription:
    """A machine; pairs are for x and y, `letters` are their axes."""
    axes = {
        letter: {
            "coordinate": coordinate,
            "counts_per_mm": counts_per_mm[index],
            "direction": direction[index],
            "travel_min_mm": -travel_mm,
            "travel_max_mm": travel_mm,
            "v_max_mm_s": v_max_mm_s[index],
            "a_max_mm_s2": a_max_mm_s2[index],
            "j_max_mm_s3": j_max_mm_s3,
        }
        for index, (letter, coordinate) in enumerate(zip(letters, "xy", strict=True))
    }
    return MachineDescription.model_validate(
        {"name": "any", "sample_period_s": sample_period_s, "axes": axes, "beam_gate": {"output": 1}}
    )


def make_path(kind: str, nodes: int, random: np.random.Generator) -> ToolPath:
    """A path of one of `KINDS` with about `nodes` nodes, within the travel."""
    if kind in ("raster", "maze"):
        pitch_mm = float(random.choice([0.25, 1.0]))
        side_mm = pitch_mm * max(np.sqrt(nodes) - 1, 1)
        area = Rectangle(-3.0, side_mm - 3.0, -2.0, side_mm - 2.0)
        if kind == "maze":
            return maze(area, pitch_mm, int(random.integers(1000)))
        return raster(area, pitch_mm, pitch_mm * float(random.choice([0.4, 1.0, 3.0])), random.choice(["x", "y"]))
    if kind == "slanted walk":
        x, y = np.cumsum(random.normal(size=(2, nodes)), axis=1) * random.choice([0.01, 0.3, 2.0])
    elif kind == "grid walk":  # reversals, repeated nodes, an axis that stands
        x, y = np.cumsum(random.integers(-1, 2, size=(2, nodes)), axis=1) * random.choice([0.1, 1.0])
    elif kind == "spiral":
        turn = np.linspace(0.0, random.uniform(0.1, 20.0), nodes)
        x, y = 3 * turn * np.cos(turn), 3 * turn * np.sin(turn)
    elif kind == "slanted line":
        angle, along = random.uniform(0, 2 * np.pi), np.cumsum(random.lognormal(-1.0, 1.0, size=nodes))
        x, y = along * np.cos(angle), along * np.sin(angle)
    else:
        x, y = 0.5 * np.arange(nodes), random.normal(size=nodes) * random.choice([1e-6, 1e-4, 1e-2])
    inside = 0.5 * TRAVEL_MM
    return ToolPath(*(np.clip(values - values.mean(), -inside, inside) for values in (x, y)))


def make_dwell(segments: int, random: np.random.Generator) -> np.ndarray:
    """Times of the segments: alike, wildly different, with zeros and long ones, or all the same."""
    kind = random.integers(3)
    if kind == 0:
        return random.lognormal(-3.0, random.choice([0.1, 1.0, 2.0]), size=segments)
    if kind == 1:
        return np.full(segments, random.choice([0.002, 0.01, 0.05, 0.2]))
    return random.choice([0.0, 0.0021, 0.005, 0.5, 3.0], size=segments)


@st.composite
def jobs(draw: st.DrawFn, max_nodes: int = 150, coarsest_counts_per_mm: float = 100.0) -> Job:
    """A timed path and the machine that is to walk it."""
    kind = draw(st.sampled_from(KINDS))
    random = np.random.default_rng(draw(st.integers(0, 10_000)))
    nodes = draw(st.sampled_from([2, 3, 5, 20, max_nodes]))
    v_mm_s, a_mm_s2 = draw(st.sampled_from(STAGES))
    counts = draw(st.sampled_from([max(scale, coarsest_counts_per_mm) for scale in SCALES]))
    machine = make_machine(
        counts_per_mm=(counts, counts * draw(st.sampled_from([1.0, 0.3, 2.0]))),
        direction=(draw(st.sampled_from([1, -1])), draw(st.sampled_from([1, -1]))),
        letters=draw(st.sampled_from(["AB", "BA", "CF"])),
        v_max_mm_s=(v_mm_s, v_mm_s * draw(st.sampled_from([1.0, 0.6]))),
        a_max_mm_s2=(a_mm_s2, a_mm_s2 * draw(st.sampled_from([1.0, 0.5]))),
        j_max_mm_s3=draw(st.sampled_from([None, None, None, 100 * a_mm_s2, 5 * a_mm_s2])),
        sample_period_s=draw(st.sampled_from(PERIODS_S)),
    )
    path = make_path(kind, nodes, random)
    return Job(kind, path, make_dwell(path.segments, random), machine, draw(st.sampled_from([0.005, 0.025, 0.2])))
