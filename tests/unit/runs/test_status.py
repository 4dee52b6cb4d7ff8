import threading
import time
from pathlib import Path

import numpy as np

from ibfctl.runs import status
from ibfctl.runs.status import StatusWriter


def test_the_last_word_is_in_the_file_and_numbers_ascend(tmp_path: Path) -> None:
    assert status.read(tmp_path) is None
    writer = StatusWriter(tmp_path, {"run": "r1"}, first_seq=7)
    writer.tell(state="running", executed=np.int64(3), margin_s=np.inf)
    writer.tell(executed=4)
    writer.close()
    told = status.read(tmp_path)
    assert told is not None
    assert (told["run"], told["state"], told["executed"], told["margin_s"]) == ("r1", "running", 4, None)
    assert told["seq"] > 7
    assert "at" in told


def test_the_file_is_always_whole(tmp_path: Path) -> None:
    writer = StatusWriter(tmp_path, {"run": "r1", "padding": "x" * 20_000})
    writer.tell(executed=0)
    seen: list[int] = []
    deadline = time.monotonic() + 10
    finished = threading.Event()

    def tell() -> None:
        executed = 0
        while not finished.is_set():
            executed += 1
            writer.tell(executed=executed)

    teller = threading.Thread(target=tell)
    teller.start()
    while len(set(seen)) < 4 and time.monotonic() < deadline:
        told = status.read(tmp_path)
        if told is not None:
            seen.append(told["executed"])
    finished.set()
    teller.join()
    writer.close()
    assert len(set(seen)) >= 4
    assert seen == sorted(seen)


def test_a_folder_that_cannot_be_written_holds_nobody_up(tmp_path: Path) -> None:
    folder = tmp_path / "absent"
    writer = StatusWriter(folder, {})
    writer.tell(executed=1)
    folder.mkdir()
    writer.tell(executed=2)
    writer.close()
    told = status.read(folder)
    assert told is not None
    assert told["executed"] == 2
