"""Access rules of the page: the requested host name, a token, and the page's origin."""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
from collections.abc import Iterable
from http import HTTPStatus
from pathlib import Path
from urllib.parse import urlsplit

from armd.daemon.bridges.view.http import NotServed, Request
from armd.errors import BadInput
from armd.files.inputs import read_input

COOKIE = "armd_view"
SHORTEST_TOKEN = 16
OTHERS_MAY_READ = 0o004


class Access:
    """The access rules of one server.

    An unknown name in the browser's address bar is refused. A foreign site whose name was made to
    resolve to this machine (DNS rebinding) has its own name there.
    """

    def __init__(
        self, names: Iterable[str] = (), token: str | None = None, secure: bool = False
    ) -> None:
        """Set the rules; *names* reach the server beside those of loopback; *secure*: by TLS."""
        self._names = {name.lower() for name in names}
        self._secure = "; Secure" if secure else ""
        self._token = token

    def check_host(self, request: Request) -> None:
        """Check the host's name; raises `NotServed`.

        Any port is allowed, because a tunnel has a port of its own.
        """
        host = request.headers.get("host", "")
        if not self._is_ours(host):
            raise NotServed(HTTPStatus.FORBIDDEN, f"found Host {host[:100]!r}, expected ours")

    def check_origin(self, request: Request) -> None:
        """Check that a request that changes something comes from our own page.

        Raises `NotServed` if it does not.
        """
        origin = request.headers.get("origin")
        host = request.headers.get("host", "")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            raise NotServed(
                HTTPStatus.FORBIDDEN, f"found Origin {origin[:100]!r}, expected our page"
            )
        if request.headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
            raise NotServed(HTTPStatus.FORBIDDEN, "found another site's page, expected our own")

    def check_token(self, request: Request) -> None:
        """Check the token, as cookie or as `Authorization: Bearer`; raises `NotServed`."""
        if not self.knows(request):
            raise NotServed(HTTPStatus.UNAUTHORIZED, "expected the token")

    def knows(self, request: Request) -> bool:
        if self._token is None:
            return True
        header = request.headers.get("authorization", "")
        if header.startswith("Bearer "):
            return self.is_token(header.removeprefix("Bearer ").strip())
        cookie = request.cookie(COOKIE)
        return cookie is not None and hmac.compare_digest(cookie.encode(), self._cookie().encode())

    def is_token(self, text: str) -> bool:
        return self._token is not None and hmac.compare_digest(
            text.strip().encode(), self._token.encode()
        )

    def cookie_header(self) -> str:
        """Return the cookie for a client that has shown the token.

        It does not contain the token, and no script can read it.
        """
        return f"{COOKIE}={self._cookie()}; Path=/; HttpOnly; SameSite=Strict{self._secure}"

    def _cookie(self) -> str:
        assert self._token is not None
        return hmac.new(self._token.encode(), b"armd view cookie", hashlib.sha256).hexdigest()

    def _is_ours(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        return is_loopback(name) or name in self._names


def is_loopback(name: str) -> bool:
    """Return whether a host's name or address can only mean the machine itself."""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def read_token(path: Path) -> str:
    """Read the token, the only line of a file; raises `BadInput`.

    A file that everybody may read is refused.
    """
    token = read_input(path).decode("utf-8", "replace").strip()
    if len(token) < SHORTEST_TOKEN or len(token.split()) != 1 or not token.isascii():
        expected = f"one word of {SHORTEST_TOKEN} letters or more, as of: openssl rand -hex 16"
        raise BadInput(path, "the token", f"{len(token)} letters", expected)
    mode = path.stat().st_mode
    if mode & OTHERS_MAY_READ:
        raise BadInput(path, "its mode", f"{mode & 0o777:o}", "640 or stricter: it is a secret")
    return token
