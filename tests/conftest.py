"""Every test gives back what it took: threads, child processes and sockets left behind fail it."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

GRACE_S = 2.0
LIVES_AS_LONG_AS_WE_DO = ("multiprocessing.resource_tracker", "multiprocessing.forkserver")


def _threads() -> set[str]:
    return {f"thread {thread.name} ({thread.ident})" for thread in threading.enumerate()}


def _processes() -> set[str]:
    children = set()
    for listing in Path("/proc/self/task").glob("*/children"):
        try:
            pids = listing.read_text().split()
        except OSError:  # the thread has ended meanwhile
            continue
        for pid in pids:
            try:
                command = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ").strip()
            except OSError:
                continue
            if command and not any(name in command for name in LIVES_AS_LONG_AS_WE_DO):
                children.add(f"process {pid} ({command})")
    return children


def _sockets() -> set[str]:
    sockets = set()
    for descriptor in Path("/proc/self/fd").glob("*"):
        try:
            target = str(descriptor.readlink())
        except OSError:
            continue
        if target.startswith("socket:"):
            sockets.add(target)
    return sockets


def _taken() -> set[str]:
    return _threads() | _processes() | _sockets()


@pytest.fixture(autouse=True)
def own_state_folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Locks and data of tests are not those of the user."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.getbasetemp() / "state"))


@pytest.fixture(autouse=True)
def no_leaks() -> Iterator[None]:
    before = _taken()
    yield
    deadline = time.monotonic() + GRACE_S
    while (left := _taken() - before) and time.monotonic() < deadline:
        gc.collect()
        time.sleep(0.01)
    if left:
        pytest.fail(f"left behind: {', '.join(sorted(left))}")
