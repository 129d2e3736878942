"""The part of HTTP/1.1 that one page needs: reading a request, formatting an answer."""

from __future__ import annotations

import asyncio
import http.client
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qsl, unquote, urlsplit

MOST_HEAD_BYTES = 16 << 10
MOST_BODY_BYTES = 64 << 10
#: Limit for a length's digits: Python raises for a number of some thousand digits.
MOST_DIGITS = 12
#: Time limit from connecting to the last byte of the request.
PATIENCE_S = 10.0

#: The page loads nothing from other sites, and no other page may embed it.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
GUARDS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}


class NotServed(Exception):
    """A request that is refused, with the reason."""

    def __init__(self, status: HTTPStatus, text: str) -> None:
        super().__init__(text)
        self.status = status


@dataclass(frozen=True)
class Request:
    """A request; header names are in lower case."""

    method: str
    path: str
    query: Mapping[str, str]
    headers: Mapping[str, str]
    body: bytes = b""

    def cookie(self, name: str) -> str | None:
        try:
            morsel = SimpleCookie(self.headers.get("cookie", "")).get(name)
        except CookieError:
            return None
        return None if morsel is None else morsel.value

    def json(self) -> dict[str, Any]:
        """Return the body's JSON object, empty without a body; raises `NotServed`."""
        try:
            content = json.loads(self.body or b"{}")
        except (ValueError, RecursionError) as error:
            problem = f"found {type(error).__name__}, expected JSON"
            raise NotServed(HTTPStatus.BAD_REQUEST, problem) from error
        if not isinstance(content, dict):
            raise NotServed(HTTPStatus.BAD_REQUEST, "found JSON, expected a JSON object")
        return content


async def read_request(reader: asyncio.StreamReader) -> Request:
    """Read a request.

    Raises `NotServed` for an invalid one, and asyncio's exceptions for a connection that ends.
    """
    async with asyncio.timeout(PATIENCE_S):
        try:
            head = await reader.readuntil(b"\r\n\r\n")
        except asyncio.LimitOverrunError as error:
            status = HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE
            raise NotServed(status, f"found a head of more than {MOST_HEAD_BYTES} bytes") from error
        request = parse(head)
        length = request.headers.get("content-length", "0")
        if "transfer-encoding" in request.headers or not (length.isascii() and length.isdigit()):
            raise NotServed(HTTPStatus.LENGTH_REQUIRED, "expected a body of known length")
        if len(length) > MOST_DIGITS or int(length) > MOST_BODY_BYTES:
            problem = (
                f"found a length of {length[:MOST_DIGITS]}, expected {MOST_BODY_BYTES} at most"
            )
            raise NotServed(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, problem)
        body = await reader.readexactly(int(length))
    return Request(request.method, request.path, request.query, request.headers, body)


def parse(head: bytes) -> Request:
    """Parse a request's head, up to its empty line; raises `NotServed`."""
    line, _, header_bytes = head.partition(b"\r\n")
    words = line.decode("latin-1").split(" ")
    if len(words) != 3 or not words[2].startswith("HTTP/1."):
        raise NotServed(HTTPStatus.BAD_REQUEST, "expected METHOD TARGET HTTP/1.1")
    try:
        fields = http.client.parse_headers(io.BytesIO(header_bytes)).items()
        target = urlsplit(words[1])
    except (http.client.HTTPException, ValueError) as error:
        raise NotServed(HTTPStatus.BAD_REQUEST, f"found {type(error).__name__}") from error
    headers: dict[str, str] = {}
    for name, value in fields:
        if name.lower() in headers and name.lower() in ("host", "content-length", "origin"):
            raise NotServed(HTTPStatus.BAD_REQUEST, f"found {name} twice")
        headers[name.lower()] = value
    query = dict(parse_qsl(target.query, keep_blank_values=True, max_num_fields=None))
    return Request(words[0], unquote(target.path), query, headers)


def format_answer(
    status: HTTPStatus, kind: str, body: bytes = b"", headers: Mapping[str, str] | None = None
) -> bytes:
    """Format a whole answer; the connection ends after it."""
    length = {"Content-Length": str(len(body)), "Connection": "close"}
    return format_head(status, kind, length | dict(headers or {})) + body


def format_head(status: HTTPStatus, kind: str, headers: Mapping[str, str]) -> bytes:
    """Format an answer's head, up to the empty line."""
    fields = {"Content-Type": kind, "Cache-Control": "no-store", **GUARDS, **headers}
    lines = [f"HTTP/1.1 {status.value} {status.phrase}"]
    lines += [f"{name}: {value}" for name, value in fields.items()]
    return ("\r\n".join(lines) + "\r\n\r\n").encode("latin-1")
