"""Power spectral densities on paper."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter

from ibfctl.planning.spectra import Change
from ibfctl.report.panels import new_figure, save

_TITLES = {"x": "along x", "y": "along y", "radial": "averaged over directions"}
_UNITS = {"x": "nm² mm", "y": "nm² mm", "radial": "nm² mm²"}
_BEFORE, _AFTER = "#b2182b", "#1f3b5c"
# Below this share of the largest density there is nothing but rounding.
_FLOOR = 1e-12
_FEW = 100.0


def draw_spectra(changes: Mapping[str, Change], path: Path) -> None:
    """Write spectra before and after as a PNG, one diagram for each direction."""
    figure = new_figure(3.6)
    axes = figure.subplots(1, len(changes))
    for axis, (name, change) in zip(axes, changes.items(), strict=True):
        top = change.before.density[1:].max(initial=np.finfo(np.float64).tiny / _FLOOR)
        for label, spectrum, colour in (("before", change.before, _BEFORE), ("after", change.after, _AFTER)):
            shown = spectrum.density[1:].clip(min=_FLOOR * top)
            axis.loglog(spectrum.frequency_per_mm[1:], shown, color=colour, linewidth=1.0, label=label)
        axis.set_title(f"PSD {_TITLES[name]}", loc="left", fontsize=10.5)
        axis.set_xlabel("spatial frequency / (1/mm)")
        axis.set_ylabel(f"density / ({_UNITS[name]})")
        place = change.before.frequency_per_mm[1:]
        few = place.size == 0 or place[-1] < _FEW * place[0]
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
        axis.xaxis.set_major_formatter("{x:.3g}")
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.grid(color="0.9", linewidth=0.6)
        axis.set_axisbelow(True)
    axes[0].legend(frameon=False)
    save(figure, path)
