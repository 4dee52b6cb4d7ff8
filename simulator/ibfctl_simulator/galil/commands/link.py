"""Ethernet handles: who is connected, and dropping connections."""

from __future__ import annotations

import re

from ibfctl_simulator.galil import errors
from ibfctl_simulator.galil.commands.request import Handler, Request
from ibfctl_simulator.galil.errors import CommandError
from ibfctl_simulator.galil.handles import LETTERS, Handle

TCP_CLOSE, TCP_RESET = "2", "3"

_CLOSE = re.compile(r"([A-HST])\s*=\s*>\s*-([123])")


def which_handle(request: Request) -> str:
    """`WH`: the handle that asks."""
    return f"IH{request.handle}" if request.handle else "RS232"


def tell_handles(request: Request) -> str:
    """`TH`: the controller's addresses and all handles."""
    lines = ["CONTROLLER IP ADDRESS 127,0,0,1 ETHERNET ADDRESS 00-50-4C-00-00-01"]
    for letter in LETTERS:
        handle = request.handles.get(letter)
        if handle is None:
            lines.append(f"IH{letter} AVAILABLE")
        else:
            address = handle.address.replace(".", ",").replace(":", "-")
            lines.append(f"IH{letter} TCP PORT 23 TO IP ADDRESS {address} PORT {handle.port}")
    return "\r\n".join(lines)


def close_handles(request: Request) -> None:
    """`IHA=>-2`, `IHS=>-3`, `IHT=>-3`: close (-2) or reset (-3) a handle, the own one, all others."""
    match = _CLOSE.fullmatch(request.text.strip())
    if match is None:
        raise CommandError(errors.OPERAND)
    for handle in _chosen(request, match[1]):
        if match[2] == TCP_RESET:
            handle.reset()
        elif match[2] == TCP_CLOSE:
            handle.close()


def _chosen(request: Request, which: str) -> list[Handle]:
    if which == "T":
        return [handle for handle in request.handles.all() if handle.letter != request.handle]
    handle = request.handles.get(request.handle if which == "S" else which)
    return [] if handle is None else [handle]


TABLE: dict[str, Handler] = {"WH": which_handle, "TH": tell_handles, "IH": close_handles}
