"""Flow of a program: jumps, subroutines, conditions."""

from __future__ import annotations

import re

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import AXIS_INDEX
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.programs.thread import Wait
from ibfctl_simulator.galil.state import INPUTS

_COUNT_CONDITION = re.compile(r"_BT([A-H])(<|>=)([A-Za-z]\w*|\d+)")


def jump(request: Request) -> Wait | None:
    """`JP #label`, `JP #label,condition`."""
    thread = request.program_thread()
    place = _destination_if(request)
    if place is None:
        return None
    if place == thread.place - 1:
        spin = _spin(request)
        if spin is not None:
            return spin
    thread.place = place
    return None


def call(request: Request) -> None:
    """`JS #label`, `JS #label,condition`."""
    thread = request.program_thread()
    place = _destination_if(request)
    if place is not None:
        thread.call(place)


def end(request: Request) -> None:
    """`EN`: return from a subroutine or end the thread; `ENDIF`: nothing."""
    thread = request.program_thread()
    if request.text.strip() == "DIF":
        return
    if thread.stack:
        thread.leave(restore_wait=thread.stack[-1].reason == "CMDERR")
    else:
        request.engine.halt(thread.number)


def return_from_error(request: Request) -> None:
    """`RE`: return from `#LIMSWI`, `#POSERR` or `#TCPERR`; `RE 1` goes on with the trippoint left."""
    _leave(request, {"LIMSWI", "POSERR", "TCPERR"})


def return_from_input(request: Request) -> None:
    """`RI`: return from `#ININT`; `RI 1` goes on with the trippoint left."""
    _leave(request, {"ININT"})


def drop_stack(request: Request) -> None:
    """`ZS`: forget where subroutines return to."""
    request.program_thread().stack.clear()


def begin_if(request: Request) -> None:
    """`IF (condition)`."""
    thread = request.program_thread()
    if not request.text.strip():
        raise CommandError(errors.TOO_FEW_FIELDS)
    if request.value(request.text) == 0.0:
        thread.place = _behind_branch(request, thread.place, stop_at_else=True)


def begin_else(request: Request) -> None:
    """`ELSE`, met at the end of the branch that was carried out."""
    thread = request.program_thread()
    if request.text.strip() != "SE":
        raise CommandError(errors.UNKNOWN_COMMAND)
    thread.place = _behind_branch(request, thread.place, stop_at_else=False)


def watch_inputs(request: Request) -> None:
    """`II m,n`: inputs m to n interrupt to `#ININT` when they go low; `II 0` ends it."""
    fields = [field for field in request.text.split(",") if field.strip()]
    if not fields:
        raise CommandError(errors.TOO_FEW_FIELDS)
    first = round(request.value(fields[0]))
    last = round(request.value(fields[1])) if len(fields) > 1 else first
    if not 0 <= first <= last <= INPUTS:
        raise CommandError(errors.OUT_OF_RANGE)
    request.engine.watched_inputs = set(range(first, last + 1)) if first else set()


def _destination_if(request: Request) -> int | None:
    """Where to go; None if the condition is not met."""
    target, comma, condition = request.text.partition(",")
    if comma and request.value(condition) == 0.0:
        return None
    return destination(request, target)


def _spin(request: Request) -> Wait | None:
    """Wait instead of a statement that jumps to itself while a PVT count has not reached (or has) a number.

    The statement would see the count change in the sample in which it changes, and so does the wait; but time need
    not be cut into single samples for it.
    """
    condition = request.text.partition(",")[2]
    match = _COUNT_CONDITION.fullmatch(condition.strip())
    if match is None:
        return None
    axis = request.state.axes[AXIS_INDEX[match[1]]]
    below, count = match[2] == "<", match[3]
    return Wait(
        lambda: request.value(condition) == 0.0,
        lull=lambda: axis.samples_until_executed(int(request.value(count))) if below else None,
    )


def destination(request: Request, target: str) -> int:
    """Return the place of `#label` or of a line number.

    Raises
    ------
    CommandError
        10 for an undefined label, 11 for a line that does not exist.
    """
    target = target.strip()
    program = request.engine.program
    if target.startswith("#"):
        return program.at_label(target[1:])
    return program.at_line(round(request.value(target)) if target else 0)


def _leave(request: Request, reasons: set[str]) -> None:
    thread = request.program_thread()
    if thread.serving not in reasons:
        raise CommandError(errors.ONLY_IN_PROGRAM)
    while thread.stack[-1].reason == "call":
        thread.stack.pop()
    thread.leave(restore_wait=request.text.strip() == "1")


def _behind_branch(request: Request, place: int, *, stop_at_else: bool) -> int:
    """Place behind the `ELSE` or `ENDIF` that ends the branch at `place`."""
    statements, depth = request.engine.program.statements, 0
    for index in range(place, len(statements)):
        text = statements[index].text
        if text.startswith("ENDIF"):
            if depth == 0:
                return index + 1
            depth -= 1
        elif text.startswith("IF"):
            depth += 1
        elif text == "ELSE" and depth == 0 and stop_at_else:
            return index + 1
    raise CommandError(errors.NO_ENDIF)


TABLE: dict[str, Handler] = {
    "JP": jump,
    "JS": call,
    "EN": end,
    "RE": return_from_error,
    "RI": return_from_input,
    "ZS": drop_stack,
    "IF": begin_if,
    "EL": begin_else,
    "II": watch_inputs,
}
