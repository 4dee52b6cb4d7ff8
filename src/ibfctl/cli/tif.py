"""`ibfctl tif`: an influence function from maps before and after the tool stood still."""

from __future__ import annotations

from pathlib import Path

import click

from ibfctl.cli.options import json_option, output_option
from ibfctl.cli.output import check_writable, print_json, print_lines


@click.command(name="tif")
@click.argument("before")
@click.argument("after")
@click.option("--dwell-s", type=float, required=True, help="How long the tool stood still, s.")
@click.option("--radius-mm", type=float, help="Where its footprint ends, mm; default: where it is lost in noise.")
@click.option("--map-pixel-mm", type=float, help="Pixel size of both maps, mm, where the files do not say it.")
@click.option("--map-unit", metavar="UNIT", help="Unit of heights (nm, um, m, ...) where the files have none.")
@click.option("--map-array", metavar="NAME", help="Array of .mat or HDF5 maps; default: Z_to_remove, else Z.")
@output_option("tif.npz")
@json_option
def command(
    before: str,
    after: str,
    dwell_s: float,
    radius_mm: float | None,
    map_pixel_mm: float | None,
    map_unit: str | None,
    map_array: str | None,
    output: Path,
    as_json: bool,
) -> None:
    """Make a tool influence function from two maps of the same place, BEFORE and AFTER a dwell.

    Piston and tilt of the surroundings are taken out of the difference; where nothing was removed must be seen.
    """
    check_writable(output, before, after)
    from ibfctl.files import save_npz
    from ibfctl.jobs.inputs import MapFile
    from ibfctl.surface.footprint import footprint

    first, second = (MapFile(path, map_pixel_mm, map_unit, map_array).read() for path in (before, after))
    found = footprint(first, second, dwell_s, radius_mm)
    influence = found.influence
    save_npz(output, rate_nm_s=influence.rate_nm_s, pixel_mm=influence.pixel_mm)
    if found.noise_dominates:
        click.echo(
            f"warning: the noise of {found.noise_nm:.3g} nm dominates, the volume rate is uncertain by "
            f"{found.volume_error:.1%}; let the tool stand longer, or average more measurements",
            err=True,
        )
    if as_json:
        print_json(
            {
                "peak_rate_nm_s": influence.peak_rate_nm_s,
                "volume_rate_nm_mm2_s": influence.volume_rate_nm_mm2_s,
                "volume_error": found.volume_error,
                "noise_dominates": found.noise_dominates,
                "noise_nm": found.noise_nm,
                "x_mm": found.x_mm,
                "y_mm": found.y_mm,
                "radius_mm": found.radius_mm,
            }
        )
        return
    print_lines(
        [
            ("peak rate", f"{influence.peak_rate_nm_s:.4g} nm/s"),
            ("volume rate", f"{influence.volume_rate_nm_mm2_s:.4g} nm mm²/s, ± {found.volume_error:.2%}"),
            ("centre", f"{found.x_mm:.4g}, {found.y_mm:.4g} mm"),
            ("radius", f"{found.radius_mm:.4g} mm"),
            ("noise around it", f"{found.noise_nm:.3g} nm"),
            ("written", str(output)),
        ]
    )
