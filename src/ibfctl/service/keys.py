"""Keys of people and programs: a role each, stored hashed, in one file of the data folder.

A token is a random secret of 256 bits, so that one round of SHA-256 is enough: there is nothing to guess.
Importing this loads nothing heavy; the command line uses it without a service.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import secrets
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from enum import IntEnum
from pathlib import Path

from ibfctl.errors import InputError
from ibfctl.files import atomic_path

_FILE = "keys.json"
_PREFIX = "ibf"


class Role(IntEnum):
    """What a key may do; a higher role may all that a lower one may.

    Every role may abort and stop in an emergency.
    """

    VIEW = 0
    OPERATE = 1
    ADMIN = 2

    @classmethod
    def named(cls, name: str) -> Role:
        """Return the role of a name in lower case."""
        return cls[name.upper()]


@dataclass(frozen=True)
class Key:
    """One key; its secret is not kept, only the secret's SHA-256."""

    id: str
    name: str
    role: str
    created: str
    sha256: str

    @property
    def may(self) -> Role:
        """What this key may do."""
        return Role.named(self.role)


class KeyRing:
    """All keys of one data folder; a change of the file, by whomever, holds from the next request on."""

    def __init__(self, data: Path) -> None:
        self._path = data / _FILE
        self._seen: tuple[int, int, int] | None = None
        self._keys: dict[str, Key] = {}

    def all_keys(self) -> Sequence[Key]:
        """Return all keys, oldest first."""
        self._refresh()
        return list(self._keys.values())

    def add(self, name: str, role: Role) -> tuple[Key, str]:
        """Make a key; return it and the token, which is not kept and cannot be shown again."""
        if any(key.name == name for key in self.all_keys()):
            raise InputError(f"key {name}: there is one of this name", "give another name, or remove that one first")
        identity, secret = secrets.token_hex(4), secrets.token_urlsafe(32)
        created = datetime.now(UTC).isoformat(timespec="seconds")
        key = Key(identity, name, role.name.lower(), created, _hashed(secret))
        self._write([*self._keys.values(), key])
        return key, f"{_PREFIX}_{identity}_{secret}"

    def remove(self, name: str) -> Key:
        """Remove the key of a name or id; whoever holds it is refused from now on."""
        for key in self.all_keys():
            if name in (key.name, key.id):
                self._write([other for other in self._keys.values() if other is not key])
                return key
        raise InputError(f"key {name}: does not exist", "`ibfctl keys list` shows all")

    def find(self, token: str) -> Key | None:
        """Return the key of a token, None where it is none."""
        self._refresh()
        prefix, _, rest = token.partition("_")
        identity, _, secret = rest.partition("_")
        key = self._keys.get(identity)
        if prefix != _PREFIX or key is None or not hmac.compare_digest(key.sha256, _hashed(secret)):
            return None
        return key

    def _refresh(self) -> None:
        try:
            found = self._path.stat()
        except FileNotFoundError:
            self._seen, self._keys = None, {}
            return
        seen = (found.st_mtime_ns, found.st_size, found.st_ino)
        if seen != self._seen:
            stored = json.loads(self._path.read_text(encoding="utf-8"))
            self._keys = {item["id"]: Key(**item) for item in stored}
            self._seen = seen

    def _write(self, keys: list[Key]) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(self._path) as partial:
            descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
                json.dump([asdict(key) for key in keys], stream, indent=1)


def _hashed(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()
