"""What lets a process that moves or watches something react within a few milliseconds, whatever else it does."""

from __future__ import annotations

import gc
import sys

SWITCH_INTERVAL_S = 0.5e-3


def ready_to_answer_soon() -> None:
    """Let threads change places quickly, and never search again for garbage among what was loaded by now.

    By default a thread that wakes up waits up to 5 ms for another one that computes, and a full collection of all that
    the product imports takes tens of milliseconds. To be called once all is loaded, in a process of its own.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
