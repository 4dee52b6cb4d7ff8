"""Programs: loading, listing, starting and halting them."""

from __future__ import annotations

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.arguments import integer
from ibfctl_simulator.galil.commands.flow import destination
from ibfctl_simulator.galil.commands.request import Download, Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.programs.engine import THREADS

END_OF_UPLOAD = "\x1a"


def download(request: Request) -> Download:
    """`DL`: the following lines replace the program."""
    request.require_client()
    if request.text.strip() not in ("", "0"):
        raise CommandError(errors.OPERAND)
    if request.engine.running:
        raise CommandError(errors.PROGRAM_RUNNING)
    return Download()


def upload(request: Request) -> bytes:
    """`UL`: the program, each line with CR LF, and a control-Z; an empty program is one empty line."""
    request.require_client()
    lines = request.engine.program.lines or ("",)
    text = "".join(f"{line}\r\n" for line in lines)
    return (text + END_OF_UPLOAD).encode("latin-1")


def list_program(request: Request) -> str:
    """`LS`: the program with line numbers."""
    lines = enumerate(request.engine.program.lines)
    return "\r\n".join(f"{number} {line}" for number, line in lines)


def list_labels(request: Request) -> str:
    """`LL`: the labels with their lines."""
    return "\r\n".join(f"#{label}={line}" for label, line in request.engine.program.labels.items())


def execute(request: Request) -> None:
    """`XQ #label,n`, `XQ line,n`, `XQ`: start thread n (0) at a place."""
    target, comma, number = request.text.partition(",")
    place = destination(request, target) if target.strip() else 0
    if not request.engine.program.lines:
        raise CommandError(errors.UNDEFINED_LABEL)
    thread = integer(request.value(number), 0, THREADS - 1) if comma and number.strip() else 0
    request.engine.start(place, thread)


def halt(request: Request) -> None:
    """`HX n`, `HX`: end a thread, or all."""
    request.engine.halt(request.number(0, THREADS - 1) if request.text.strip() else None)


def nothing(request: Request) -> None:
    """`NO text`: a comment."""


TABLE: dict[str, Handler] = {
    "DL": download,
    "UL": upload,
    "LS": list_program,
    "LL": list_labels,
    "XQ": execute,
    "HX": halt,
    "NO": nothing,
}
