"""Starting anew: after power was off, or by `RS`."""

from __future__ import annotations

from ibfctl_simulator.galil.handles import Handles
from ibfctl_simulator.galil.programs.engine import Engine
from ibfctl_simulator.galil.state import State


def restart(state: State, engine: Engine, handles: Handles, *, keep_connections: bool) -> None:
    """Take up what was burned and run `#AUTO`; connections are reset unless they are to be kept."""
    if not keep_connections:
        for handle in handles.all():
            handle.reset()
    handles.power_up()
    state.power_up()
    engine.power_up()
