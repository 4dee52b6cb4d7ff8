"""What lets a process that moves or watches something react within a few milliseconds, whatever else the host does."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from pathlib import Path

SWITCH_INTERVAL_S = 0.5e-3


def ready_to_answer_soon() -> None:
    """Let threads change places quickly, and never search again for garbage among what was loaded by now.

    By default a thread that wakes up waits up to 5 ms for another one that computes, and a full collection of all that
    the product imports takes tens of milliseconds. To be called once all is loaded, in a process of its own.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()


def let_others_go_first() -> None:
    """Use only processor time that nobody else wants, in this process, which leads a session of its own.

    To be nice is not enough: where Linux gives every session its share of the processors, that holds only among the
    processes of one session; and a process that is nice still keeps a core for milliseconds that a run needs.
    """
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    with contextlib.suppress(OSError):  # no such shares here
        Path("/proc/self/autogroup").write_text("19", encoding="ascii")
