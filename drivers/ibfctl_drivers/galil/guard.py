"""The guard: a small program on the controller that closes the beam gate when the host no longer can.

It runs in thread 0, where the controller calls its automatic subroutines. While the gate is open it looks at
every axis' stop code, at the age of the host's last sign of life, and at how many segments still wait. When the
motion has ended as it should, it closes the gate. When anything else has happened, it closes the gate, stops all
axes of the job, and ends; so it does when a limit, a position error or a lost handle interrupts it.

Thread 1 is the shutter: it opens the gate when so many segments are over, and closes it when so many are, to about
a sample. Whoever closes the gate halts it, so that nobody opens the gate again behind their back.
"""

from __future__ import annotations

from collections.abc import Sequence

from ibfctl.errors import ControllerError
from ibfctl_drivers.galil.codec import message_of, parse_integers
from ibfctl_drivers.galil.gate import GateOutput
from ibfctl_drivers.galil.link import Link

NAME = "#IBFGRD"
THREAD_RUNS = "_XQ0"
THREADS = 8
PLACES = 255
SIGN_OF_LIFE = "gbeat=TIME"
LOOPS_IN_PATIENCE = 250
LOW_WATER_LOOPS = 5
"""The guard takes the buffer for about to run dry when it holds less than it needs for so many looks."""
SAMPLES_PER_S = 1024
OPENER, CLOSER = "#IBFGAT", "#IBFCLS"
"""Where the shutter's thread begins: with the gate still closed, or already open."""

OUTLIVE_ABORT_INPUT = "CN ,,,,1"
"""The abort input stops the axes and not the programs: somebody must be left to close the gate."""

ALLOWED_CODES = (1, 30, 31, 50, 51)
"""Standing at the start, PVT and contour running, PVT and contour ended."""


def guard_lines(letters: Sequence[str], gate: GateOutput) -> list[str]:
    """Return the program's lines for the axes and the gate of a job."""
    complete = ["&".join(f"(_SC{letter}={code})" for letter in letters) for code in (31, 51)]
    stopped = ["&".join(f"(_SC{letter}<>{code})" for code in ALLOWED_CODES) for letter in letters]
    first, shut = letters[0], gate.shut_commands
    return [
        NAME,
        "WT gwait",
        "JP #IBFSTP,gtrip=1",
        f"JP {NAME},{gate.closed_condition}",
        *(f"JP #IBFEND,{condition}" for condition in complete),
        *(f"JP #IBFSTP,{condition}" for condition in (*stopped, f"(_CM=511)&(_SC{first}=50)")),
        f"JP #IBFSTP,(_PV{first}>glow)&(gend=0)",
        "JP #IBFSTP,(TIME-gbeat)>gpat",
        f"JP {NAME}",
        "#IBFEND",
        *shut,
        f"JP {NAME}",
        "#IBFSTP",
        *shut,
        "gold=(TIME-gbeat)>gpat",
        f"gdry=(_PV{first}>glow)&(gend=0)",
        f"ST {''.join(letters)}",
        "EN",
        *(line for label in ("#LIMSWI", "#POSERR", "#TCPERR") for line in (label, *shut, "gtrip=1", "RE")),
        # The count of the motion before stands until this one has begun: an old one opens nothing.
        OPENER,
        f"JP {OPENER},_BT{first}>=gopen",
        "#IBFOPN",
        f"JP #IBFOPN,_BT{first}<gopen",
        gate.open_command,
        "gopn=TIME",
        CLOSER,
        f"JP {CLOSER},_BT{first}<gclose",
        gate.close_command,
        gate.stamp_command,
        "EN",
    ]


class Guard:
    """The guard program of one controller.

    Parameters
    ----------
    link
        Handle for questions and signs of life.
    lines
        The program, of `guard_lines`.
    """

    def __init__(self, link: Link, lines: Sequence[str]) -> None:
        self._link = link
        self._lines = list(lines)
        self._low_water_samples = 0

    def owner_age_s(self) -> float | None:
        """Seconds since the last sign of life to a guard that runs; None where none runs."""
        if self._thread_lines()[0] < 0:
            return None
        question = message_of(["TIME-gbeat"])
        return parse_integers(self._link.ask(question), 1, question)[0] / SAMPLES_PER_S

    def start(self, patience_s: float) -> None:
        """Load the program unless it is there, read it back, and start it anew.

        Parameters
        ----------
        patience_s
            Age of the last sign of life, in seconds of the controller, at which the host counts as gone.

        Raises
        ------
        ControllerError
            If the controller holds another program, does not hold or run this one afterwards, or would end it with the
            abort input.
        """
        present = self._link.upload()
        if present != self._lines:
            if present and NAME not in present:
                raise ControllerError(
                    f"the controller holds another program (first line {present[0]!r})",
                    "save it, clear the controller's program memory, and start again",
                )
            self._halt()
            self._refuse_running_threads()
            self._link.download(self._lines)
            if self._link.upload() != self._lines:
                raise ControllerError("the guard program does not read back as it was loaded")
        self._halt()
        self._link.tell(OUTLIVE_ABORT_INPUT)
        if parse_integers(self._link.ask("MG _CN4"), 1, "MG _CN4") != [1]:
            raise ControllerError(
                "the guard would end with the controller's abort input",
                f"find out why it does not keep {OUTLIVE_ABORT_INPUT}",
            )
        self._link.tell(f"gpat={round(patience_s * SAMPLES_PER_S)}")
        wait = max(round(patience_s * 1000 / LOOPS_IN_PATIENCE), 2)
        self._low_water_samples = LOW_WATER_LOOPS * wait
        for assignment in (f"gwait={wait}", "gtrip=0", "gend=0", f"glow={PLACES}", "gold=0", "gdry=0"):
            self._link.tell(assignment)
        self._link.tell(SIGN_OF_LIFE)
        self._link.tell(f"XQ {NAME},0")
        if self._thread_lines()[0] < 0:
            raise ControllerError("the guard program does not run", "look at the controller's program errors")

    def stop(self) -> None:
        """Halt the program; without it nobody closes the gate but the host."""
        self._halt()

    def reason(self) -> str:
        """Say why the guard has stopped the axes."""
        question = message_of(["gdry", "gold", "gtrip"])
        dry, old, trip = parse_integers(self._link.ask(question), 3, question)
        if trip:  # it has emptied the buffer, so that comes after
            return "a limit, a position error or a lost handle"
        if old:
            return "the host was silent for too long"
        return "the buffer was about to run empty" if dry else "an axis stopped, or the guard was halted"

    def low_water_samples(self) -> int:
        """Least motion that must wait in the buffer, until the end marker does."""
        return self._low_water_samples

    def _halt(self) -> None:
        self._link.tell("HX 1")
        self._link.tell("HX 0")

    def _refuse_running_threads(self) -> None:
        for thread, line in enumerate(self._thread_lines()):
            if line >= 0:
                raise ControllerError(
                    f"a program runs on the controller (thread {thread}, line {line})",
                    "halt it before the guard is loaded",
                )

    def _thread_lines(self) -> list[int]:
        question = message_of(f"_XQ{thread}" for thread in range(THREADS))
        return parse_integers(self._link.ask(question), THREADS, question)
