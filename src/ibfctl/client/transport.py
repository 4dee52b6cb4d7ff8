"""Requests to the service: JSON in and out, files in a stream, problems as errors."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import httpx

from ibfctl.client.records import Event
from ibfctl.errors import IbfctlError, InputError
from ibfctl.files import atomic_path

_PATIENCE_S = 60.0
_RETRY_S = 0.5
_BYTES = 1 << 16


class UnreachableError(IbfctlError):
    """No service answers."""

    code = "unreachable"
    exit_code: ClassVar[int] = 9


class RefusedError(IbfctlError):
    """The service refuses a request; `kind` is the `code` of its problem, `status` the HTTP status."""

    code = "refused"
    exit_code: ClassVar[int] = 9

    def __init__(self, status: int, kind: str, message: str, hint: str) -> None:
        super().__init__(message, hint)
        self.status = status
        self.kind = kind


class Transport:
    """One connection pool to one service."""

    def __init__(self, url: str, key: str | None, timeout_s: float) -> None:
        if key is not None and not (key.isascii() and key.isprintable()):
            raise InputError("the key holds what no key holds", "copy it again from where `ibfctl keys add` printed it")
        headers = {} if key is None else {"Authorization": f"Bearer {key}"}
        self._url = url
        try:
            self._http = httpx.Client(base_url=url, headers=headers, timeout=timeout_s)
        except httpx.InvalidURL as error:
            raise self._unreachable(error) from error

    def close(self) -> None:
        """Close all connections."""
        self._http.close()

    def ask(self, method: str, place: str, **options: Any) -> Any:
        """Make a request and return what is answered, None where there is no content.

        Raises
        ------
        RefusedError, UnreachableError
            If the service refuses, or none answers.
        """
        try:
            answer = self._http.request(method, place, **options)
        except (httpx.TransportError, httpx.InvalidURL, httpx.UnsupportedProtocol) as error:
            raise self._unreachable(error) from error
        except ValueError as error:  # JSON has neither NaN nor infinity
            raise InputError(f"{place}: cannot be asked for ({error})", "give finite numbers") from error
        _check(answer)
        try:
            return answer.json() if answer.content else None
        except ValueError as error:
            raise self._unreachable(error) from error

    def upload(self, place: str, path: Path, params: Mapping[str, Any]) -> Any:
        """Send a file as the body, piece by piece."""
        with path.open("rb") as stream:
            given = {name: value for name, value in params.items() if value is not None}
            return self.ask("POST", place, params=given, content=iter(lambda: stream.read(_BYTES), b""))

    def download(self, place: str, path: Path) -> None:
        """Write a file that the service answers, completely or not at all."""
        try:
            with self._http.stream("GET", place, timeout=_PATIENCE_S) as answer:
                if answer.is_error:
                    answer.read()
                _check(answer)
                with atomic_path(path) as partial, partial.open("wb") as stream:
                    for chunk in answer.iter_bytes():
                        stream.write(chunk)
        except httpx.TransportError as error:
            raise self._unreachable(error) from error

    def events(self, params: Mapping[str, Any], after: int | None, *, follow: bool) -> Iterator[Event]:
        """Yield events; a stream that breaks off is taken up where it was, for a minute without success at most."""
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            headers = {} if after is None else {"Last-Event-ID": str(after)}
            try:
                asked = {**params, "follow": follow}
                with self._http.stream("GET", "/v1/events", params=asked, headers=headers, timeout=30.0) as answer:
                    if answer.is_error:
                        answer.read()
                    _check(answer)
                    for event in _events(answer.iter_lines()):
                        deadline = time.monotonic() + _PATIENCE_S
                        after = after if event["id"] is None else event["id"]
                        yield event
            except httpx.TransportError as error:
                if not follow or time.monotonic() > deadline:
                    raise self._unreachable(error) from error
            if not follow:
                return
            time.sleep(_RETRY_S)

    def _unreachable(self, error: Exception) -> UnreachableError:
        hint = "start `ibfctl serve`, or give --url or IBFCTL_URL"
        if "CERTIFICATE_VERIFY_FAILED" in str(error):
            hint = "name the file of the authority that signed its certificate in SSL_CERT_FILE"
        return UnreachableError(f"no service answers at {self._url} ({error})", hint)


def _check(answer: httpx.Response) -> None:
    if not answer.is_error:
        return
    try:
        told = answer.json()
        raise RefusedError(answer.status_code, told["code"], told["detail"], told["hint"])
    except (ValueError, KeyError, TypeError) as error:
        detail = f"{answer.request.url}: answered {answer.status_code} {answer.reason_phrase}"
        raise RefusedError(answer.status_code, "refused", detail, "is this an ibfctl service?") from error


def _events(lines: Iterator[str]) -> Iterator[Event]:
    """Parse server-sent events as the service writes them: one line of data each."""
    fields: dict[str, str] = {}
    for line in lines:
        name, _, value = line.partition(": ")
        if line and not line.startswith(":"):
            fields[name] = value
        elif not line and fields:
            identity = fields.get("id")
            yield Event(
                id=None if identity is None else int(identity), event=fields["event"], data=json.loads(fields["data"])
            )
            fields = {}
