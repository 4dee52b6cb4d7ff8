"""The whole controller as a function of simulated time; sockets and clocks are elsewhere."""

from __future__ import annotations

from ibfctl_simulator.galil.errors import LOST_CONNECTION
from ibfctl_simulator.galil.handles import LETTERS, Handles
from ibfctl_simulator.galil.interpreter import Interpreter, Reply
from ibfctl_simulator.galil.programs.engine import Engine
from ibfctl_simulator.galil.programs.memory import Program
from ibfctl_simulator.galil.record import RecordPusher
from ibfctl_simulator.galil.restart import restart
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.state import State
from ibfctl_simulator.galil.trace import TraceWriter


class Controller:
    """Axes, programs and command interpreter.

    Parameters
    ----------
    settings
        Model and behaviour.
    trace
        Takes what the axes do.
    program
        Burned program, which runs its `#AUTO` at power-up.
    """

    def __init__(
        self,
        settings: Settings | None = None,
        trace: TraceWriter | None = None,
        program: Program | None = None,
    ) -> None:
        self.settings = settings or Settings()
        self.state = State(self.settings, trace)
        self.handles = Handles()
        self.engine = Engine(self.state, self.handles.emit)
        self.engine.burned = program or Program()
        self.pusher = RecordPusher()
        self._interpreter = Interpreter(self.state, self.handles, self.engine, self.pusher)
        self.engine.power_up()

    def reply(self, command: str, handle: str) -> Reply:
        """Carry out one command of the client on `handle`; see `Interpreter.reply`."""
        return self._interpreter.reply(command, handle)

    def advance_to(self, time_s: float) -> None:
        """Let all samples that end at or before the simulated time `time_s` pass."""
        due = self.state.samples_due(time_s)
        if due:
            self.advance(due)

    def advance(self, samples: int) -> None:
        """Let `samples` samples pass, programs and pushed records included."""
        end = self.state.sample + samples
        while self.state.sample < end:
            self.engine.run(self._interpreter.execute)
            most = end - self.state.sample
            for limit in (self.engine.samples_to_wait(), self.pusher.samples_left(self.state.sample)):
                most = most if limit is None else min(most, limit)
            self.state.advance(most)
            self.pusher.push(self.state, self.handles, self.engine)

    def lost(self, handle: str) -> None:
        """A client went away without closing: latch error 123 and tell the programs."""
        self.state.error_code = LOST_CONNECTION
        self.engine.lost(LETTERS.index(handle))

    def power_cycle(self) -> None:
        """Reset every connection and start anew from what was burned."""
        restart(self.state, self.engine, self.handles, keep_connections=False)
