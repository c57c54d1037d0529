"""What every request passes: limits on size and rate, who sent it, CSRF, and headers on the answer.

Plain ASGI middleware, so that bodies are counted as they come and nothing is buffered.
"""

from __future__ import annotations

import hmac
import time
from collections import OrderedDict
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from fastapi import Request, Response
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lilgym_mp.web.authentication import COOKIE, COOKIE_SECONDS, Logins, Signer
from lilgym_mp.web.errors import error_response

CSRF_HEADER = "X-CSRF-Token"
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
OPEN_PATHS = ("/assets/", "/login", "/healthz")  # need no token
MOST_BYTES = 256 * 1024  # of a request's body
MOST_IMPORT_BYTES = 32 * 1024 * 1024
IMPORT_PATH = "/api/annotate/imports"
BURST_SECONDS = 10  # a visitor may be this far ahead of its rate
ADDRESS_FACTOR = 50  # an address may send as much as so many visitors
MOST_BUCKETS = 20_000
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}


class SecurityHeaders:
    """Puts the headers on every answer."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await self.app(scope, receive, with_headers if scope["type"] == "http" else send)


class KnownHosts:
    """Refuses requests for another host name, as a page elsewhere could make them by naming this server."""

    def __init__(self, app: ASGIApp, hosts: tuple[str, ...] | None) -> None:
        self.app = app
        self.hosts = hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and self.hosts is not None:
            host = _host_name(Headers(scope=scope).get("host", ""))
            if host not in self.hosts:
                await _answer(scope, receive, send, 400, f"this server is not called {host[:100]!r}")
                return
        await self.app(scope, receive, send)


def _host_name(host: str) -> str:
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


class _TooLarge(Exception):
    """A body that goes on past its limit."""


class BodyLimit:
    """Refuses bodies that are too large, by what they say and by what comes."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        most = MOST_IMPORT_BYTES if scope["path"] == IMPORT_PATH else MOST_BYTES
        said = Headers(scope=scope).get("content-length", "0")
        refused = f"a request has at most {most:,} bytes"
        if not said.isdecimal() or int(said[:20]) > most:
            await _answer(scope, receive, send, 413, refused)
            return
        received, began = 0, False

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > most:
                raise _TooLarge
            return message

        async def noted(message: Message) -> None:
            nonlocal began
            began = True
            await send(message)

        try:
            await self.app(scope, counted, noted)
        except _TooLarge:
            if not began:
                await _answer(scope, receive, send, 413, refused)


class _Buckets:
    """Token buckets by key, the longest unused forgotten first."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self.most = rate * BURST_SECONDS
        self._kept: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, and when there were so many

    def take(self, key: str) -> bool:
        """Whether one more request of this key is within its rate."""
        moment = time.monotonic()
        tokens, since = self._kept.pop(key, (self.most, moment))
        tokens = min(self.most, tokens + (moment - since) * self.rate)
        self._kept[key] = (tokens - 1 if tokens >= 1 else tokens, moment)
        if len(self._kept) > MOST_BUCKETS:
            self._kept.popitem(last=False)
        return tokens >= 1


class Callers:
    """Knows who sends a request, keeps them to their rate, and refuses what was not sent from a page of ours."""

    def __init__(
        self, app: ASGIApp, logins: Logins, signer: Signer, rate: float | None, *, requires_tokens: bool
    ) -> None:
        self.app = app
        self._logins = logins
        self._signer = signer
        self._of_visitors = None if rate is None else _Buckets(rate)
        self._of_addresses = None if rate is None else _Buckets(rate * ADDRESS_FACTOR)
        self._requires_tokens = requires_tokens

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        caller = scope["visitor"] = self._signer.caller(_cookie(headers))
        address = scope["client"][0] if scope.get("client") else ""
        if not self._within_rate(address if caller.is_new else caller.id, address):
            await _answer(scope, receive, send, 429, "too many requests; wait a moment", {"Retry-After": "2"})
            return
        path: str = scope["path"]
        if not path.startswith("/assets/") and not caller.is_new:
            caller.person = await self._logins.person(caller.id)
        if self._requires_tokens and caller.person is None and not path.startswith(OPEN_PATHS):
            await _answer(scope, receive, send, 401, "open the link with your token: it logs you in")
            return
        if scope["method"] not in SAFE_METHODS:
            fault = self._csrf_fault(headers, caller.csrf_token)
            if fault:
                await _answer(scope, receive, send, 403, fault)
                return

        async def with_cookie(message: Message) -> None:
            if message["type"] == "http.response.start" and caller.is_new and not path.startswith("/assets/"):
                set_cookie(MutableHeaders(scope=message), self._signer.cookie(caller.id))
            await send(message)

        await self.app(scope, receive, with_cookie)

    def _within_rate(self, visitor: str, address: str) -> bool:
        if self._of_visitors is None or self._of_addresses is None:
            return True
        return self._of_addresses.take(address) and self._of_visitors.take(visitor)

    def _csrf_fault(self, headers: Headers, token: str) -> str | None:
        origin = headers.get("origin")
        if origin is not None and urlsplit_host(origin) != headers.get("host", ""):
            return "this request was not sent from a page of this server"
        if not hmac.compare_digest(headers.get(CSRF_HEADER, "").encode(), token.encode()):
            return f"the header {CSRF_HEADER} is missing or out of date; reload the page (GET /api/session tells it)"
        return None


def urlsplit_host(origin: str) -> str:
    """Host and port of an origin; empty for what is none."""
    try:
        return urlsplit(origin).netloc
    except ValueError:
        return ""


def _cookie(headers: Headers) -> str | None:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return None
    return found.value if found else None


def set_cookie(headers: MutableHeaders, value: str) -> None:
    """Gives the browser its cookie, which no script can read and no other site's request carries."""
    headers.append("Set-Cookie", f"{COOKIE}={value}; Path=/; Max-Age={COOKIE_SECONDS}; HttpOnly; SameSite=Lax")


async def _answer(
    scope: Scope, receive: Receive, send: Send, status: int, message: str, headers: dict[str, str] | None = None
) -> None:
    response: Response = error_response(Request(scope), status, message)
    response.headers.update(headers or {})
    await response(scope, receive, send)
