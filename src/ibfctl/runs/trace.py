"""What was really executed: positions and gate, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from ibfctl.errors import InputError
from ibfctl.machine.description import MachineDescription
from ibfctl.machine.program import IntArray


@dataclass(frozen=True)
class RunTrace:
    """The as-run trace of a machine; samples at which nothing moves and no output is set have no row.

    Attributes
    ----------
    sample : (n,) int64
        Index of the controller's sample, ascending; gaps mean that nothing changed.
    position_counts : mapping of axis letter to (n,) int64
        Encoder position.
    gate_open : (n,) bool
        Whether the beam gate output was open.
    sample_period_s : float
        Length of one controller sample.
    """

    sample: IntArray
    position_counts: Mapping[str, IntArray]
    gate_open: NDArray[np.bool_]
    sample_period_s: float


def read_emulator_trace(path: Path, machine: MachineDescription) -> RunTrace:
    """Read the trace that the emulated controller wrote.

    Parameters
    ----------
    path
        HDF5 file with ``sample`` (n,), ``position_counts`` (n, axes) and ``outputs`` (n,), where bit k - 1
        is output k, and the attributes ``sample_period_s`` and ``axes``.
    machine
        Says which axes and which output to look at.

    Raises
    ------
    InputError
        If the file is no such trace, or lacks an axis of the machine.
    """
    try:
        with h5py.File(path, "r") as file:
            axes = str(file.attrs["axes"])
            sample_period_s = float(file.attrs["sample_period_s"])
            sample = np.asarray(file["sample"], dtype=np.int64)
            positions = np.asarray(file["position_counts"], dtype=np.int64)
            outputs = np.asarray(file["outputs"], dtype=np.uint64)
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"trace {path}: cannot be read ({error})", "run the simulation again") from error
    missing = sorted(set(machine.axes) - set(axes))
    if missing or positions.shape != (sample.size, len(axes)) or outputs.shape != sample.shape:
        raise InputError(
            f"trace {path}: holds axes {axes or 'none'} in shape {positions.shape}, "
            f"machine {machine.name!r} has {''.join(sorted(machine.axes))}",
            "start the emulated controller with the machine's axes",
        )
    is_set = (outputs >> np.uint64(machine.beam_gate.output - 1)) & np.uint64(1) == 1
    return RunTrace(
        sample=sample,
        position_counts={letter: positions[:, axes.index(letter)] for letter in sorted(machine.axes)},
        gate_open=is_set if machine.beam_gate.open_when == "set" else ~is_set,
        sample_period_s=sample_period_s,
    )
