"""Recovery as a process of its own, for whoever must not load numerics or wait for a machine.

``python -m ibfctl.runs.recovery_act recover|resume FOLDER`` prints one JSON line with an ``event``: ``finished`` with
the fields of `ibfctl.runs.recovery.Recovered` as ``figures``, or ``failed``. ``resume`` starts a worker at the seam.
"""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path

from ibfctl.errors import IbfctlError
from ibfctl.runs.adoption import interrupt_orphans
from ibfctl.runs.launch import let_go
from ibfctl.runs.plain import dump
from ibfctl.runs.recovery import recover, resume


def main() -> int:
    """Do one act; return the exit code."""
    act, folder = sys.argv[1], Path(sys.argv[2])
    try:
        interrupt_orphans(folder.parent.parent)
        found = recover(folder)
        if act == "resume":
            let_go(resume(folder, found))
    except IbfctlError as error:
        print(dump({"event": "failed", "code": error.code, "message": error.message, "hint": error.hint}))
        return error.exit_code
    print(dump({"event": "finished", "figures": asdict(found)}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
