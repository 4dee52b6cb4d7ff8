"""What a client uploads, piece by piece as it arrives: the raw body, or the one file of a multipart form."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from ibfctl.service.problems import ServiceError

_FORM = b"multipart/form-data"
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_FILE = {"schema": {"type": "object", "required": ["file"], "properties": {"file": _BINARY["schema"]}}}
BODY: dict[str, Any] = {
    "requestBody": {
        "description": "The file itself, or a form with one file.",
        "content": {"application/octet-stream": _BINARY, "multipart/form-data": _FILE},
    }
}
"""For the description of an operation that takes a file."""


async def content_of(request: Request, limit_bytes: int) -> AsyncIterator[bytes]:
    """Yield what is uploaded.

    Raises
    ------
    ServiceError
        If the body is larger than the limit, or a form that does not hold exactly one file.
    """
    kind, options = parse_options_header(request.headers.get("content-type"))
    form = _Form(options.get(b"boundary", b"")) if kind == _FORM else None
    received = 0
    async for chunk in request.stream():
        received += len(chunk)
        if received > limit_bytes:
            raise ServiceError(413, f"body is larger than {limit_bytes} bytes", "crop or bin the map")
        if form is None:
            yield chunk
            continue
        for piece in form.pieces(chunk):
            yield piece
    if form is not None:
        form.finish()


class _Form:
    """Takes the one file out of a multipart form."""

    def __init__(self, boundary: bytes) -> None:
        if not boundary:
            raise _refused("the form's content type names no boundary")
        self._pieces: list[bytes] = []
        self._header = self._value = b""
        self._in_file = False
        self._files = 0
        self._ended = False
        self._parser = MultipartParser(
            boundary,
            {
                "on_part_begin": self._begin_part,
                "on_header_field": self._take_name,
                "on_header_value": self._take_value,
                "on_header_end": self._end_header,
                "on_part_data": self._take_data,
                "on_end": self._end,
            },
        )

    def pieces(self, chunk: bytes) -> list[bytes]:
        """Return what of the file is in the next chunk of the body."""
        self._pieces = []
        try:
            self._parser.write(chunk)
        except FormParserError as error:
            raise _refused(f"the form cannot be read ({error})") from error
        return self._pieces

    def finish(self) -> None:
        """Refuse a form that was cut off, or that holds no file or several."""
        if not self._ended or self._files != 1:
            raise _refused(f"the form holds {self._files} files" if self._ended else "the form has no end")

    def _begin_part(self) -> None:
        self._in_file = False

    def _take_name(self, data: bytes, start: int, end: int) -> None:
        self._header += data[start:end]

    def _take_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _end_header(self) -> None:
        if self._header.lower() == b"content-disposition" and b"filename" in parse_options_header(self._value)[1]:
            self._in_file = True
            self._files += 1
        self._header = self._value = b""

    def _take_data(self, data: bytes, start: int, end: int) -> None:
        if self._in_file and self._files == 1:
            self._pieces.append(data[start:end])

    def _end(self) -> None:
        self._ended = True


def _refused(detail: str) -> ServiceError:
    return ServiceError(422, detail, "send the file itself as the body, or a form with one file", "bad_request")
