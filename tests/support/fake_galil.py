"""A scripted controller behind a real socket: it does as it is told, or as a test wants it to misbehave."""

from __future__ import annotations

import contextlib
import re
import socket
import threading
import time
from collections.abc import Callable
from typing import Self

STREAM, STATUS, GATE, ABORT = range(4)
PROMPT, REFUSAL = b":", b"?"
Answer = Callable[[int, str], "bytes | None"]


class FakeGalil:
    """Answers commands on any number of handles and logs them in the order in which they arrive.

    `fault(handle, command)` may return bytes to send instead of the true answer, or None for that answer;
    it may also raise `ConnectionResetError` to reset the handle. Moves take no time, and PVT goes on by
    `segments_per_poll` whenever the counts are asked for: nothing depends on the clock but `TIME`.
    """

    def __init__(self, fault: Answer | None = None, sample_rate_hz: float = 1024.0) -> None:
        self.log: list[tuple[int, str]] = []
        self.fault = fault or (lambda handle, command: None)
        self.identity = "DMC4020 Rev 1.3a"
        self.reason = "0"
        self.outputs: dict[int, int] = {}
        self.position = {"A": 0, "B": 0}
        self.target = dict(self.position)
        self.queued: dict[str, list[tuple[int, int, int]]] = {"A": [], "B": []}
        self.executed = {"A": 0, "B": 0}
        self.stop_code = {"A": 1, "B": 1}
        self.motor_off = {"A": 1, "B": 1}
        self.segments_per_poll = 20
        self.program: list[str] = []
        self.guard_line = -1
        self.shutter_line = -1
        self.elapsed = 0
        self.variables: dict[str, int] = {}
        self._download: list[str] | None = None
        self._rate_hz = sample_rate_hz
        self._lock = threading.Lock()
        self._sockets: list[socket.socket] = []
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._start(self._accept)
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._threads[0].join()
        for handle in self._sockets:
            with contextlib.suppress(OSError):
                handle.shutdown(socket.SHUT_RDWR)
            handle.close()
        for thread in self._threads:
            thread.join()

    def sent(self, handle: int) -> list[str]:
        return [command for number, command in self.log if number == handle]

    def first(self, command: str) -> int:
        return [logged for _, logged in self.log].index(command)

    def shout(self, handle: int, data: bytes) -> None:
        """Send bytes that nobody asked for."""
        self._sockets[handle].sendall(data)

    def _start(self, target: Callable[..., None], *arguments: object) -> None:
        thread = threading.Thread(target=target, args=arguments)
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while True:
            try:
                handle, _ = self._listener.accept()
            except OSError:
                return
            self._sockets.append(handle)
            self._start(self._serve, len(self._sockets) - 1, handle)

    def _serve(self, number: int, handle: socket.socket) -> None:
        received = b""
        try:
            while data := handle.recv(4096):
                received += data
                *lines, received = received.split(b"\r")
                for line in lines:
                    command = line.decode("ascii")
                    with self._lock:
                        if self._downloads(command):
                            self.log.append((number, f"  {command}"))  # so that it is not taken for a command
                            continue
                        self.log.append((number, command))
                        answer = self.fault(number, command)
                        if answer is None:
                            answer = self.answer(command)
                    handle.sendall(answer)
        except OSError:
            pass
        finally:
            handle.close()

    def _downloads(self, line: str) -> bool:
        """Program lines get no answer."""
        if line == "DL":
            self._download = []
            return False
        if self._download is None or line == "\\":
            return False
        self._download.append(line)
        return True

    def answer(self, command: str) -> bytes:
        if command == "\x12\x16":
            return self._text(self.identity)
        if command == "TC1":
            return self._text(self.reason)
        if command == "DL":
            return b""
        if command == "\\":
            self.program, self._download = self._download or [], None
            return 2 * PROMPT
        if command == "UL":
            return "".join(f"{line}\r\n" for line in self.program).encode("ascii") + b"\x1a:"
        if command in ("XQ #IBFGRD,0", "HX 0", "AB"):
            self.guard_line = 1 if command.startswith("XQ") else -1
        if command in ("XQ #IBFCLS,1", "XQ #IBFGAT,1", "HX 1", "AB"):
            self.shutter_line = 1 if command.startswith("XQ") else -1
        if command.startswith("MG _BTA,_BTB"):
            for letter in "AB":
                self._go_on(letter)
            self._shut_when_due()
        if match := re.fullmatch(r"([a-z]\w*)=(.*)", command):
            self._assign(match[1], match[2])
        if command.startswith("MG "):
            if any(name not in self.variables for name in command[3:].split(",") if re.fullmatch(r"[a-z]\w*", name)):
                return REFUSAL
            return self._text(" ".join(f"{self._value(name):.4f}" for name in command[3:].split(",")))
        if match := re.fullmatch(r"PV([AB])=(-?\d+),(-?\d+),(-?\d+)", command):
            self._queue(match[1], *(int(number) for number in match.groups()[1:]))
        elif match := re.fullmatch(r"(SB|CB) (\d+)", command):
            self.outputs[int(match[2])] = int(match[1] == "SB")
        elif match := re.fullmatch(r"PA([AB])=(-?\d+)", command):
            self.target[match[1]] = int(match[2])
        elif match := re.fullmatch(r"(BG|BT|SH|ST|MO) ([AB]+)", command):
            self._act(match[1], match[2])
        return PROMPT

    def _assign(self, name: str, text: str) -> None:
        """Numbers, the time, another variable, and the stamp that the first one leaves."""
        if text == "gcls+((gcls=0)*TIME)":
            self.variables[name] = self.variables.get(name) or self.variables.get("gbeg", 0) + self.elapsed
        else:
            self.variables[name] = self._time() if text == "TIME" else int(self.variables.get(text, 0) or text)

    def _time(self) -> int:
        return int(time.monotonic() * self._rate_hz) % 1_000_000_000

    def _shut_when_due(self) -> None:
        """The shutter's thread, as far as closing goes."""
        if self.shutter_line >= 0 and self.executed["A"] >= self.variables["gclose"]:
            self.shutter_line, self.outputs[1] = -1, 0
            self._assign("gcls", "gcls+((gcls=0)*TIME)")

    def _queue(self, letter: str, move: int, velocity: int, time_samples: int) -> None:
        if time_samples == -1:
            self.queued[letter].clear()
        else:
            self.queued[letter].append((move, velocity, time_samples))

    def _act(self, verb: str, letters: str) -> None:
        for letter in letters:
            if verb in ("SH", "MO"):
                self.motor_off[letter] = int(verb == "MO")
            elif verb == "BG":
                self.position[letter], self.stop_code[letter] = self.target[letter], 1
            elif verb == "ST":
                self.queued[letter].clear()
                self.stop_code[letter] = 4
            elif verb == "BT":
                self.executed[letter], self.stop_code[letter] = 0, 30
                self.elapsed = 0

    def _go_on(self, letter: str) -> None:
        for _ in range(self.segments_per_poll):
            if self.stop_code[letter] != 30 or not self.queued[letter]:
                return
            move, _, time_samples = self.queued[letter].pop(0)
            self.position[letter] += move
            self.executed[letter] += 1
            self.elapsed += time_samples if letter == "A" else 0
            if time_samples == 0:
                self.stop_code[letter] = 31

    def _value(self, name: str) -> float:
        if name == "TIME":
            return self._time()
        if name in self.variables:
            return self.variables[name]
        if match := re.fullmatch(r"@OUT\[(\d+)\]", name):
            return self.outputs.get(int(match[1]), 0)
        if name == "_CN4":
            return int("CN ,,,,1" in (command for _, command in self.log))
        operand, letter = name[:3], name[3:]
        if operand == "_XQ":
            return {"0": self.guard_line, "1": self.shutter_line}.get(letter, -1)
        return {
            "_PV": 255 - len(self.queued[letter]),
            "_BT": self.executed[letter],
            "_SC": self.stop_code[letter],
            "_TP": self.position[letter],
            "_TE": 0,
            "_BG": int(self.stop_code[letter] == 30),
            "_MO": self.motor_off[letter],
        }[operand]

    @staticmethod
    def _text(text: str) -> bytes:
        return f" {text}\r\n:".encode("ascii")
