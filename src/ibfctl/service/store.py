"""Where the service keeps things: one folder per resource, named by the service alone, with a JSON record."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

from ibfctl.files import atomic_path
from ibfctl.service.problems import ServiceError

_ID = re.compile(r"[0-9a-f]{16}")
_RECORD = "record.json"
_KEYS = "keys"
MOST_CHILDREN = 2

Record = dict[str, Any]


class Collection:
    """All resources of one kind; nothing that a client sends becomes a path.

    Ids begin with the time of creation, so that their order is the order of creation.

    Attributes
    ----------
    kind
        Name of the kind, as in URLs.
    hands
        To be held by whoever has files of the kind read or made by a process of its own: each may take much memory.
    """

    def __init__(self, data: Path, kind: str) -> None:
        self._folder = data / kind
        (self._folder / _KEYS).mkdir(parents=True, exist_ok=True)
        self._making: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()
        self.hands = asyncio.Semaphore(MOST_CHILDREN)
        self.kind = kind

    def create(self) -> str:
        """Make the folder of a new resource and return its id; without a record it does not exist for clients."""
        identity = new_identity()
        (self._folder / identity).mkdir()
        return identity

    def making(self, what: str | None) -> asyncio.Lock:
        """Return what holds off whoever wants the same made a second time: the files of an id, or what a key made."""
        return asyncio.Lock() if what is None else self._making.setdefault(what, asyncio.Lock())

    def path(self, identity: str, name: str) -> Path:
        """Return the path of a file of a resource; `name` is the service's own."""
        return self._folder / identity / name

    def write(self, identity: str, record: Mapping[str, Any]) -> Record:
        """Write the record of a resource, completely or not at all, and return it."""
        stored = {"id": identity, "created": datetime.now(UTC).isoformat(timespec="milliseconds"), **record}
        _write_json(self.path(identity, _RECORD), stored)
        return stored

    def update(self, identity: str, **changes: Any) -> Record:
        """Change fields of a record."""
        return self.write(identity, {**self.read(identity), **changes})

    def exists(self, identity: str) -> bool:
        """Return whether there is such a resource."""
        return bool(_ID.fullmatch(identity)) and self.path(identity, _RECORD).is_file()

    def read(self, identity: str) -> Record:
        """Return a record, or refuse the request where there is none."""
        if not self.exists(identity):
            raise ServiceError(
                404, f"{self.kind}/{identity[:32]}: does not exist", f"GET /v1/{self.kind} lists what does"
            )
        record: Record = json.loads(self.path(identity, _RECORD).read_text(encoding="utf-8"))
        return record

    def ids(self, after: str = "") -> Iterator[str]:
        """Yield all ids after one, oldest first; who wants a few looks at no more files than that."""
        with os.scandir(self._folder) as entries:
            names = sorted(entry.name for entry in entries if entry.name > after)
        return (name for name in names if self.exists(name))

    def delete(self, identity: str) -> None:
        """Remove a resource; its record goes first, so that half of it is never seen."""
        self.path(identity, _RECORD).unlink(missing_ok=True)
        shutil.rmtree(self._folder / identity)

    def remember(self, key: str | None, fingerprint: str, identity: str) -> None:
        """Note which resource a request with an idempotency key has made."""
        if key is not None:
            _write_json(self._key_path(key), {"fingerprint": fingerprint, "id": identity})

    def recall(self, key: str | None, fingerprint: str) -> Record | None:
        """Return what an earlier request with this key has made, None where there was none.

        Raises
        ------
        ServiceError
            If the earlier request asked for something else.
        """
        if key is None or not self._key_path(key).is_file():
            return None
        note = json.loads(self._key_path(key).read_text(encoding="utf-8"))
        if not self.exists(note["id"]):
            return None
        if note["fingerprint"] != fingerprint:
            raise ServiceError(
                409, "Idempotency-Key was used for another request", "use a new key for every new request"
            )
        return self.read(note["id"])

    def _key_path(self, key: str) -> Path:
        return self._folder / _KEYS / hashlib.sha256(key.encode()).hexdigest()


def new_identity() -> str:
    """Return an id; its first digits are the time, in ms."""
    return f"{time.time_ns() // 1_000_000:011x}{secrets.randbits(20):05x}"


def fingerprint_of(*parts: Any) -> str:
    """Return a hash of what a request asks for."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _write_json(path: Path, content: Any) -> None:
    with atomic_path(path) as partial:
        partial.write_text(json.dumps(content), encoding="utf-8")
