"""Middleware for every request: security headers, allowed hosts, body size, authentication, rate limits and CSRF.

Plain ASGI rather than Starlette's BaseHTTPMiddleware: body bytes are counted as they arrive and nothing is buffered.
"""

from __future__ import annotations

import asyncio
import hmac
import time
from collections import OrderedDict
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from anyio.to_thread import run_sync
from fastapi import HTTPException, Request, Response
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lilgym_mp.web.authentication import COOKIE, COOKIE_SECONDS, CookieSigner, find_person
from lilgym_mp.web.errors import error_response
from lilgym_mp.web.store import Database

CSRF_HEADER = "X-CSRF-Token"
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
PUBLIC_PATHS = ("/assets/", "/login", "/healthz")  # path prefixes served without a login
BODY_LIMITS = 256 * 1024, 30  # bytes, seconds until the last of them
IMPORT_LIMITS = 32 * 1024 * 1024, 300
CLOSE = {"Connection": "close"}  # the rest of the body is not read
IMPORT_PATH = "/api/annotate/imports"
BURST_SECONDS = 10  # capacity of a token bucket, in seconds of its rate
ADDRESS_FACTOR = 50  # rate limit of an IP address, as a multiple of a visitor's
MAX_BUCKETS = 20_000
SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}


class SecurityHeadersMiddleware:
    """Adds SECURITY_HEADERS to every response."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await self.app(scope, receive, with_headers if scope["type"] == "http" else send)


class AllowedHostsMiddleware:
    """Refuses requests with an unknown Host header, which protects against DNS rebinding. `hosts`: None allows any."""

    def __init__(self, app: ASGIApp, hosts: tuple[str, ...] | None) -> None:
        self.app = app
        self.hosts = hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and self.hosts is not None:
            host = _host_name(Headers(scope=scope).get("host", ""))
            if host not in self.hosts:
                await _send_error(
                    scope, receive, send, 400, f"this server does not answer to the host name {host[:100]!r}"
                )
                return
        await self.app(scope, receive, send)


def _host_name(host: str) -> str:
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


class BodyLimitsMiddleware:
    """Refuses request bodies that are too large, by Content-Length and by the bytes actually received, or too slow."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        max_bytes, seconds = IMPORT_LIMITS if scope["path"] == IMPORT_PATH else BODY_LIMITS
        content_length = Headers(scope=scope).get("content-length", "0")
        too_large = f"the body of this request may have at most {max_bytes:,} bytes"
        if not content_length.isdecimal() or int(content_length[:20]) > max_bytes:
            await _send_error(scope, receive, send, 413, too_large, CLOSE)
            return
        received, is_complete = 0, False
        deadline = asyncio.get_running_loop().time() + seconds

        async def receive_limited() -> Message:
            nonlocal received, is_complete
            try:
                async with asyncio.timeout_at(None if is_complete else deadline):
                    message = await receive()
            except TimeoutError:
                raise HTTPException(408, f"the body of this request did not arrive in {seconds} s", CLOSE) from None
            received += len(message.get("body", b""))
            if received > max_bytes:
                raise HTTPException(413, too_large, CLOSE)
            is_complete = not message.get("more_body", False)
            return message

        await self.app(scope, receive_limited, send)


class _TokenBuckets:
    """Token-bucket rate limiter by key; evicts the least recently used key."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self.capacity = rate * BURST_SECONDS
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, time of last update

    def take(self, key: str) -> bool:
        """Takes a token; returns whether there was one."""
        now = time.monotonic()
        tokens, updated = self._buckets.pop(key, (self.capacity, now))
        tokens = min(self.capacity, tokens + (now - updated) * self.rate)
        self._buckets[key] = (tokens - 1 if tokens >= 1 else tokens, now)
        if len(self._buckets) > MAX_BUCKETS:
            self._buckets.popitem(last=False)
        return tokens >= 1


class CallerMiddleware:
    """Identifies the caller, applies rate limits, requires a login where configured, and checks CSRF tokens."""

    def __init__(
        self, app: ASGIApp, database: Database, signer: CookieSigner, rate: float | None, *, requires_tokens: bool
    ) -> None:
        self.app = app
        self._database = database
        self._signer = signer
        self._visitor_buckets = None if rate is None else _TokenBuckets(rate)
        self._address_buckets = None if rate is None else _TokenBuckets(rate * ADDRESS_FACTOR)
        self._requires_tokens = requires_tokens

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        caller = scope["caller"] = self._signer.caller(_cookie(headers))
        address = scope["client"][0] if scope.get("client") else ""
        if not self._within_rate(address if caller.is_new else caller.id, address):
            await _send_error(scope, receive, send, 429, "too many requests; wait a moment", {"Retry-After": "2"})
            return
        path: str = scope["path"]
        if not path.startswith("/assets/") and not caller.is_new:
            caller.person = await run_sync(find_person, self._database, caller.id)
        if self._requires_tokens and caller.person is None and not path.startswith(PUBLIC_PATHS):
            await _send_error(scope, receive, send, 401, "open the link with your token to log in")
            return
        if scope["method"] not in SAFE_METHODS:
            error = self._csrf_error(headers, caller.csrf_token)
            if error:
                await _send_error(scope, receive, send, 403, error)
                return

        async def with_cookie(message: Message) -> None:
            if message["type"] == "http.response.start" and caller.is_new and not path.startswith("/assets/"):
                set_cookie(MutableHeaders(scope=message), self._signer.cookie(caller.id))
            await send(message)

        await self.app(scope, receive, with_cookie)

    def _within_rate(self, visitor: str, address: str) -> bool:
        if self._visitor_buckets is None or self._address_buckets is None:
            return True
        return self._address_buckets.take(address) and self._visitor_buckets.take(visitor)

    def _csrf_error(self, headers: Headers, token: str) -> str | None:
        origin = headers.get("origin")
        if origin is not None and _origin_host(origin) != headers.get("host", ""):
            return "this request was not sent from a page of this server"
        if not hmac.compare_digest(headers.get(CSRF_HEADER, "").encode(), token.encode()):
            return f"the header {CSRF_HEADER} is missing or stale; reload the page (GET /api/session returns its value)"
        return None


def _origin_host(origin: str) -> str:
    """Host and port of an Origin header; empty if it cannot be parsed."""
    try:
        return urlsplit(origin).netloc
    except ValueError:
        return ""


def _cookie(headers: Headers) -> str | None:
    try:
        morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return None
    return morsel.value if morsel else None


def set_cookie(headers: MutableHeaders, value: str) -> None:
    """Adds the visitor cookie: not readable by scripts, not sent with cross-site requests."""
    headers.append("Set-Cookie", f"{COOKIE}={value}; Path=/; Max-Age={COOKIE_SECONDS}; HttpOnly; SameSite=Lax")


async def _send_error(
    scope: Scope, receive: Receive, send: Send, status: int, message: str, headers: dict[str, str] | None = None
) -> None:
    response: Response = error_response(Request(scope), status, message)
    response.headers.update(headers or {})
    await response(scope, receive, send)
