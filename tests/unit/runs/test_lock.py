"""One run per machine, whatever its holder dies of."""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.programs import machine

from ibfctl.errors import RunError
from ibfctl.runs.lock import MachineLock, is_held, lock_path, owner_of, take

HOLD = """
import sys, time
from pathlib import Path
from ibfctl.runs.lock import take
take(Path(sys.argv[1]), "another one")
print("held", flush=True)
time.sleep(60)
"""


def test_a_second_one_is_refused_and_told_who_holds_the_machine() -> None:
    with MachineLock(machine(), "run one"), pytest.raises(RunError, match=f"in use by run one .process {os.getpid()}"):
        MachineLock(machine(), "run two").__enter__()
    with MachineLock(machine(), "run two") as lock:
        assert is_held(lock.path)
    assert not is_held(lock.path)


def test_a_lock_ends_with_its_holder_even_by_kill_9(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    with subprocess.Popen([sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        assert is_held(path)
        assert owner_of(path) == "another one"
        assert take(path, "me") is None
        holder.kill()
    assert not is_held(path)
    descriptor = take(path, "me")
    assert descriptor is not None
    os.close(descriptor)


def test_who_only_looks_does_not_keep_anybody_out(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    path.touch()
    descriptors = [path.open() for _ in range(2)]
    for descriptor in descriptors:
        fcntl.flock(descriptor, fcntl.LOCK_SH)
    assert is_held(path) is False
    for descriptor in descriptors:
        descriptor.close()


@pytest.mark.parametrize("other", [{"host": "localhost"}, {"timeout_s": 5.0}])
def test_a_machine_has_one_lock_whatever_it_is_called(other: dict[str, object]) -> None:
    assert lock_path(machine(**other).connection) == lock_path(machine().connection)


@pytest.mark.parametrize("other", [{"port": 5024}, {"host": "127.0.0.2"}, {"serial": "/dev/ttyS7"}])
def test_other_machines_have_other_locks(other: dict[str, object]) -> None:
    assert lock_path(machine(**other).connection) != lock_path(machine().connection)
