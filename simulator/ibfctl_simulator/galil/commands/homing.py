"""Homing: which search the next `BG` begins."""

from __future__ import annotations

from typing import Literal

from ibfctl_simulator.galil.commands.request import Handler, Request


def _choose(target: Literal["FE", "HM", "FI"]) -> Handler:
    def choose(request: Request) -> None:
        axes = [request.state.axes[index] for index in request.axes()]
        for axis in axes:
            axis.require_still()
        for axis in axes:
            axis.target = target

    return choose


TABLE: dict[str, Handler] = {"FE": _choose("FE"), "HM": _choose("HM"), "FI": _choose("FI")}
