"""What lets a process that moves or watches something react within a few milliseconds, whatever else the host does."""

from __future__ import annotations

import gc
import os
import sys
import time
from pathlib import Path

SWITCH_INTERVAL_S = 0.5e-3
NICENESS = 10
"""A tenth of the time where somebody else wants all of it: a plan still gets done."""
_TRIES, _TRY_S = 5, 0.15


def ready_to_answer_soon() -> None:
    """Let threads change places quickly, and never search again for garbage among what was loaded by now.

    By default a thread that wakes up waits up to 5 ms for another one that computes, and a full collection of all that
    the product imports takes tens of milliseconds. To be called once all is loaded, in a process of its own.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()


def let_others_go_first() -> None:
    """Take what processor time others leave, in this process, which leads a session of its own.

    To be nice is not enough: where Linux gives every session its share of the processors, that holds only among the
    processes of one session.
    """
    os.nice(NICENESS)
    for _ in range(_TRIES):
        try:
            Path("/proc/self/autogroup").write_text(str(NICENESS), encoding="ascii")
        except BlockingIOError:  # all sessions together may be changed ten times a second
            time.sleep(_TRY_S)
        except OSError:  # no such shares here
            return
        else:
            return
