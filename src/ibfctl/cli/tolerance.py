"""`ibfctl tolerance`: how sure a plan's residual is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ibfctl.cli.options import Finite, json_option
from ibfctl.cli.output import print_json
from ibfctl.cli.progress import progress
from ibfctl.cli.words import tolerance_lines
from ibfctl.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor

_CONNECT_S = 10


def _sigma(name: str, default: float, help_text: str, largest: float | None = None) -> Callable[..., Any]:
    kind = Finite(min=0, max=largest)
    return click.option(name, type=kind, default=default, show_default=True, help=help_text)


@click.command(name="tolerance")
@click.argument("plan_file", metavar="PLAN.h5", type=click.Path(path_type=Path))
@click.option("--draws", type=click.IntRange(min=1), default=1000, show_default=True, help="Runs to draw.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of all random numbers.")
@_sigma("--rate-drift-percent", 1.0, "Drift of the removal rate over the run.", 30)
@_sigma("--tif-width-percent", 1.0, "Width of the TIF at the same volume rate.", 30)
@_sigma("--offset-mm", 0.05, "Registration of the part along x and along y.")
@_sigma("--rotation-mrad", 0.5, "Registration about the middle of the clear aperture.")
@_sigma("--servo-lag-ms", 5.0, "Following error over velocity, of each axis.")
@_sigma("--height-noise-nm", 0.1, "Noise of the map from pixel to pixel.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes; default: one for every core.")
@click.option("--dask", "address", metavar="ADDRESS", help="Scheduler of a Dask cluster to compute on instead.")
@json_option
def command(
    plan_file: Path,
    draws: int,
    seed: int,
    rate_drift_percent: float,
    tif_width_percent: float,
    offset_mm: float,
    rotation_mrad: float,
    servo_lag_ms: float,
    height_noise_nm: float,
    workers: int | None,
    address: str | None,
    as_json: bool,
) -> None:
    """Draw runs that differ from PLAN.h5 and show what they leave, and which cause adds most.

    The options are standard deviations; zero leaves a cause out.
    """
    from ibfctl.planning.file import read_plan
    from ibfctl.planning.tolerance import Tolerances, tolerance_of

    tolerances = Tolerances(
        rate_drift_percent, tif_width_percent, offset_mm, rotation_mrad, servo_lag_ms, height_noise_nm
    )
    plan = read_plan(plan_file)
    with _cluster(address) if address else _processes(workers) as executor, progress() as report:
        figures = tolerance_of(plan, tolerances, executor, draws=draws, seed=seed, progress=report)
    if as_json:
        print_json(figures.summary())
    else:
        click.echo("\n".join(tolerance_lines(figures.summary())))


@contextmanager
def _processes(workers: int | None) -> Iterator[Executor]:
    import multiprocessing
    import os
    import signal
    from concurrent.futures import ProcessPoolExecutor

    workers = workers or len(os.sched_getaffinity(0))
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as executor:
        # Ctrl-C reaches every process of a terminal but is for this one: the others inherit what is blocked here.
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            for _ in range(workers):
                executor.submit(int)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        yield executor


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise InputError(
            "tolerance: --dask needs Dask, which is not installed", "pip install 'ibfctl[cluster]'"
        ) from error
    try:
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"tolerance: no Dask scheduler answers at {address} ({error})", "start one, or leave --dask out"
        ) from error
    with client, client.get_executor() as executor:
        yield executor
