import json
import os
import threading
from collections import deque
from pathlib import Path
from typing import Any

import pytest

from ibfctl.errors import RunError
from ibfctl.runs.control import ControlReader, open_pipe, send


class Acts:
    """Collects what a reader passes on."""

    def __init__(self, folder: Path, expected: int) -> None:
        self.got: list[Any] = []
        self.refused: list[str] = []
        self._expected = expected
        self._all = threading.Event()
        self.descriptor = open_pipe(folder)

    def read(self) -> None:
        reader = ControlReader(self.descriptor, self._take, self._refuse)
        assert self._all.wait(10)
        reader.close()

    def _take(self, act: Any) -> None:
        self.got.append(act)
        self._count()

    def _refuse(self, line: str) -> None:
        self.refused.append(line)
        self._count()

    def _count(self) -> None:
        if len(self.got) + len(self.refused) == self._expected:
            self._all.set()


def test_acts_arrive_in_order_even_those_sent_before_anybody_reads(tmp_path: Path) -> None:
    sent = [{"act": "pause", "when": "now", "key": f"k{number}"} for number in range(200)]
    acts = Acts(tmp_path, len(sent))
    for act in sent:
        send(tmp_path, act)
    acts.read()
    assert acts.got == sent


def test_what_is_no_act_is_refused_and_the_rest_goes_on(tmp_path: Path) -> None:
    acts = Acts(tmp_path, 4)
    for line in ("nonsense", '["act"]', '{"when": "now"}', '{"act": "stop"}'):
        os.write(acts.descriptor, f"{line}\n".encode())
    acts.read()
    assert acts.got == [{"act": "stop"}]
    assert len(acts.refused) == 3


def test_without_a_worker_an_act_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="has no worker"):
        send(tmp_path, {"act": "abort"})
    os.close(open_pipe(tmp_path))
    with pytest.raises(RunError, match="has no worker"):
        send(tmp_path, {"act": "abort"})
    assert (tmp_path / "control").stat().st_mode & 0o777 == 0o600


def test_an_act_is_never_torn_apart(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="too long"):
        send(tmp_path, {"act": "interlock", "name": "x" * 5000})


def test_a_worker_that_does_not_listen_is_told_of(tmp_path: Path) -> None:
    descriptor = open_pipe(tmp_path)
    flood = ({"act": "interlock", "name": "x" * 3000} for _ in range(100))
    with pytest.raises(RunError, match="does not listen"):
        deque((send(tmp_path, act) for act in flood), maxlen=0)
    assert json.loads(os.read(descriptor, 4096).split(b"\n")[0])["act"] == "interlock"
    os.close(descriptor)
