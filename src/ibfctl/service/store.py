"""Where the service keeps things: one folder per resource, named by the service alone, with a JSON record."""

from __future__ import annotations

import json
import re
import secrets
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ibfctl.jobs.atomic import atomic_path
from ibfctl.service.problems import ServiceError

_ID = re.compile(r"[0-9a-f]{16}")
_RECORD = "record.json"

Record = dict[str, Any]


class Collection:
    """All resources of one kind; nothing that a client sends becomes a path."""

    def __init__(self, data: Path, kind: str) -> None:
        self._folder = data / kind
        self._folder.mkdir(parents=True, exist_ok=True)
        self.kind = kind

    def create(self) -> str:
        """Make the folder of a new resource and return its id; without a record it does not exist for clients."""
        identity = secrets.token_hex(8)
        (self._folder / identity).mkdir()
        return identity

    def path(self, identity: str, name: str) -> Path:
        """Return the path of a file of a resource; `name` is the service's own."""
        return self._folder / identity / name

    def write(self, identity: str, record: Mapping[str, Any]) -> Record:
        """Write the record of a resource, completely or not at all, and return it."""
        stored = {"id": identity, "created": datetime.now(UTC).isoformat(timespec="milliseconds"), **record}
        with atomic_path(self.path(identity, _RECORD)) as partial:
            partial.write_text(json.dumps(stored), encoding="utf-8")
        return stored

    def update(self, identity: str, **changes: Any) -> Record:
        """Change fields of a record."""
        return self.write(identity, {**self.read(identity), **changes})

    def read(self, identity: str) -> Record:
        """Return a record, or refuse the request where there is none."""
        path = self.path(identity, _RECORD)
        if not _ID.fullmatch(identity) or not path.is_file():
            raise ServiceError(
                404, f"{self.kind}/{identity[:32]}: does not exist", f"GET /v1/{self.kind} lists what does"
            )
        record: Record = json.loads(path.read_text(encoding="utf-8"))
        return record

    def records(self) -> list[Record]:
        """Return all records, oldest first."""
        found = [json.loads(path.read_text(encoding="utf-8")) for path in self._folder.glob(f"*/{_RECORD}")]
        return sorted(found, key=lambda record: (record["created"], record["id"]))
