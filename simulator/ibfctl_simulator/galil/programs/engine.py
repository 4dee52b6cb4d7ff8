"""Runs the program threads, a share of statements in every sample."""

from __future__ import annotations

from collections.abc import Callable

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.programs.memory import Program
from ibfctl_simulator.galil.programs.thread import Reason, Thread, Wait
from ibfctl_simulator.galil.state import State

THREADS = 8

Execute = Callable[[str, Thread], "str | Wait | None"]
"""Carries out one statement of a thread; returns a line to print or what to wait for."""


class Engine:
    """Program memory and threads.

    Parameters
    ----------
    state
        What the programs act on.
    emit
        Takes text that nobody asked for: what a program prints, and run-time errors.
    """

    def __init__(self, state: State, emit: Callable[[str], None]) -> None:
        self._state = state
        self.emit = emit
        self.program = Program()
        self.burned = Program()
        self.threads: list[Thread | None] = [None] * THREADS
        self.error_line = 0
        self.error_thread = 0
        self.lost_handle = -1
        """Number of the handle that was lost last, as `_IA4` tells."""
        self.watched_inputs: set[int] = set()
        self.reference_sample = 0
        """What `AT` counts from."""
        self._lost = False

    def power_up(self) -> None:
        """Load the burned program and start `#AUTO`."""
        self.halt()
        self.program = self.burned
        self.watched_inputs = set()
        self.lost_handle, self._lost = -1, False
        self.error_line = self.error_thread = 0
        if "AUTO" in self.program.labels:
            self.start(self.program.at_label("AUTO"), 0)

    def load(self, program: Program) -> None:
        """Replace the program.

        Raises
        ------
        CommandError
            17 while a thread runs.
        """
        if self.running:
            raise CommandError(errors.PROGRAM_RUNNING)
        self.program = program

    def start(self, place: int, number: int) -> None:
        """Start a thread.

        Raises
        ------
        CommandError
            19 if it runs already.
        """
        if self.threads[number] is not None:
            raise CommandError(errors.THREAD_RUNNING)
        self.threads[number] = Thread(number, place)

    def halt(self, number: int | None = None) -> None:
        """End one thread, or all."""
        for index in range(THREADS) if number is None else (number,):
            self.threads[index] = None

    @property
    def running(self) -> list[Thread]:
        """The threads that run."""
        return [thread for thread in self.threads if thread is not None]

    def line_of(self, number: int) -> int:
        """Line that a thread is at, -1 if it does not run."""
        thread = self.threads[number]
        return -1 if thread is None else self._line(thread)

    def lost(self, handle: int) -> None:
        """Tell that a client was lost."""
        self.lost_handle, self._lost = handle, True

    def samples_to_wait(self) -> int | None:
        """How many samples may pass before a thread has something to do; None for any number."""
        least: int | None = None
        for thread in self.running:
            wait = thread.wait
            if wait is None or wait.poll or wait.done():
                return 1
            left = wait.lull() if wait.lull is not None else None
            if wait.due is not None:
                left = wait.due - self._state.sample
            if left is not None:
                least = left if least is None else min(least, left)
        return None if least is None else max(1, least)

    def run(self, execute: Execute) -> None:
        """Run the share of one sample: automatic subroutines first, then one statement per thread in turn."""
        self._raise_interrupts()
        budget = self._state.settings.commands_per_sample
        while budget > 0:
            ready = [thread for thread in self.running if self._ready(thread)]
            if not ready:
                return
            if len(ready) == 1:
                budget -= self._run_alone(ready[0], execute, budget)
                continue
            for thread in ready[:budget]:
                if self.threads[thread.number] is thread:
                    self._step(thread, execute)
            budget -= len(ready)

    def _run_alone(self, thread: Thread, execute: Execute, budget: int) -> int:
        """Run the only ready thread until it waits or ends or the budget is used up; return what was used."""
        used = 0
        while used < budget and thread.wait is None and self.threads[thread.number] is thread:
            self._step(thread, execute)
            used += 1
        return used

    def _ready(self, thread: Thread) -> bool:
        if thread.wait is not None and thread.wait.done():
            thread.wait = None
        return thread.wait is None

    def _step(self, thread: Thread, execute: Execute) -> None:
        if thread.place >= len(self.program.statements):
            self.threads[thread.number] = None
            return
        line, statement = self.program.statements[thread.place]
        thread.place += 1
        try:
            outcome = execute(statement, thread)
        except CommandError as error:
            self._failed(thread, line, statement, error)
            return
        if isinstance(outcome, Wait):
            thread.wait = outcome
        elif outcome is not None:
            self.emit(f"{outcome}\r\n")

    def _line(self, thread: Thread) -> int:
        """Line of a thread: that of the trippoint it waits at, or of its next statement."""
        return self.program.line_of(thread.place - (thread.wait is not None))

    def _failed(self, thread: Thread, line: int, statement: str, error: CommandError) -> None:
        """Go to `#CMDERR` if there is one and it is not what failed; otherwise end the thread and say so."""
        self._state.error_code = error.code
        self.error_line, self.error_thread = line, thread.number
        if "CMDERR" not in self.program.labels or thread.serving == "CMDERR":
            self.threads[thread.number] = None
            self.emit(f"?{line} {statement}\r\n")
            return
        first = self.threads[0]
        if thread.number != 0:
            self.threads[thread.number] = None
        if first is None:
            self.start(self.program.at_label("CMDERR"), 0)
        else:
            self._interrupt(first, "CMDERR")

    def _raise_interrupts(self) -> None:
        """Send thread 0 to the automatic subroutines of what has happened; without a program it is forgotten."""
        axes, thread = self._state.axes, self.threads[0]
        happened: list[tuple[Reason, bool]] = [
            ("LIMSWI", any("limit" in axis.events for axis in axes)),
            ("POSERR", any("position_error" in axis.events for axis in axes)),
            ("TCPERR", self._lost),
            ("ININT", bool(self._state.input_events & self.watched_inputs)),
        ]
        for axis in axes:
            axis.events.clear()
        self._state.input_events.clear()
        self._lost = False
        for reason, did in happened:
            if did and thread is not None and reason in self.program.labels:
                self._interrupt(thread, reason)

    def _interrupt(self, thread: Thread, reason: Reason) -> None:
        if reason in [frame.reason for frame in thread.stack]:
            return
        try:
            thread.call(self.program.at_label(reason), reason)
        except CommandError as error:
            self._state.error_code = error.code
            self.threads[thread.number] = None
