"""Middleware for every request: security headers, allowed hosts, body size, authentication, rate limits and CSRF; and
connections that are closed unless each request arrives in time."""

from __future__ import annotations

import asyncio
import hmac
import time
from collections import OrderedDict
from typing import Any
from urllib.parse import SplitResult, urlsplit

from anyio.to_thread import run_sync
from fastapi import HTTPException, Request
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from lilgym_mp.web.app_services import ServeOptions
from lilgym_mp.web.authentication import COOKIE, COOKIE_SECONDS, Caller, CookieSigner, find_person
from lilgym_mp.web.errors import error_response
from lilgym_mp.web.store.database import Database

CSRF_HEADER = "X-CSRF-Token"
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
PUBLIC_PATHS = ("/assets/", "/login", "/healthz")  # path prefixes served without a login
BODY_LIMITS = 256 * 1024, 30  # bytes, seconds until the last of them
REQUEST_SECONDS = 30.0  # until the headers of a request are complete, from the connection or the last response
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


class Guard:
    """Refuses requests that break a rule, identifies the caller of the others, and adds headers to every response.

    Plain ASGI, not Starlette's BaseHTTPMiddleware: body bytes are counted as they arrive and nothing is buffered.
    """

    def __init__(self, app: ASGIApp, database: Database, signer: CookieSigner, options: ServeOptions) -> None:
        self.app = app
        self._database = database
        self._signer = signer
        self._hosts = options.hosts
        self._requires_tokens = options.requires_tokens
        rate = options.requests_per_second
        self._buckets = None if rate is None else (_TokenBuckets(rate * ADDRESS_FACTOR), _TokenBuckets(rate))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        caller: Caller | None = None  # once admitted

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
                if caller is not None and caller.is_new and not scope["path"].startswith("/assets/"):
                    cookie = f"{COOKIE}={self._signer.cookie(caller.id)}"  # a login has replaced the id
                    headers.append("Set-Cookie", f"{cookie}; Path=/; Max-Age={COOKIE_SECONDS}; HttpOnly; SameSite=Lax")
            await send(message)

        headers = Headers(scope=scope)
        try:
            self._check_host(headers)
            receive_limited = _limited(receive, scope["path"], headers)
            caller = await self._admit(scope, headers)
        except HTTPException as refusal:
            response = error_response(Request(scope), refusal.status_code, refusal.detail)
            response.headers.update(refusal.headers or {})
            await response(scope, receive, send_with_headers)
            return
        await self.app(scope, receive_limited, send_with_headers)

    def _check_host(self, headers: Headers) -> None:
        """Raises HTTPException for an unknown Host header, which protects against DNS rebinding."""
        host = headers.get("host", "")
        if self._hosts is not None and (_split(f"//{host}").hostname or "") not in self._hosts:
            raise HTTPException(400, f"this server does not answer to the host name {host[:100]!r}")

    async def _admit(self, scope: Scope, headers: Headers) -> Caller:
        """The caller. Raises HTTPException for too many requests, or without a login or CSRF token."""
        path: str = scope["path"]
        caller = scope["caller"] = self._signer.caller(Request(scope).cookies.get(COOKIE))
        address = scope["client"][0] if scope.get("client") else ""
        keys = (address, address if caller.is_new else caller.id)
        if self._buckets is not None and not all(map(_TokenBuckets.take, self._buckets, keys)):
            raise HTTPException(429, "too many requests; wait a moment", {"Retry-After": "2"})
        if not path.startswith("/assets/") and not caller.is_new:
            caller.person = await run_sync(find_person, self._database, caller.id)
        if self._requires_tokens and caller.person is None and not path.startswith(PUBLIC_PATHS):
            raise HTTPException(401, "open the link with your token to log in")
        if scope["method"] not in SAFE_METHODS:
            _check_csrf(headers, caller.csrf_token)
        return caller


def _check_csrf(headers: Headers, token: str) -> None:
    """Raises HTTPException unless the request was sent by a page of this server."""
    origin = headers.get("origin")
    if origin is not None and _split(origin).netloc != headers.get("host", ""):
        raise HTTPException(403, "this request was not sent from a page of this server")
    if not hmac.compare_digest(headers.get(CSRF_HEADER, "").encode(), token.encode()):
        message = f"the header {CSRF_HEADER} is missing or stale; reload the page (GET /api/session returns its value)"
        raise HTTPException(403, message)


def _limited(receive: Receive, path: str, headers: Headers) -> Receive:
    """`receive` for a body of limited size and duration; raises HTTPException beyond, now if Content-Length says so."""
    max_bytes, seconds = IMPORT_LIMITS if path == IMPORT_PATH else BODY_LIMITS
    too_large = f"the body of this request may have at most {max_bytes:,} bytes"
    content_length = headers.get("content-length", "0")
    if not content_length.isdecimal() or int(content_length[:20]) > max_bytes:
        raise HTTPException(413, too_large, CLOSE)
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

    return receive_limited


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


def _split(url: str) -> SplitResult:
    """The parts of a URL; empty if it cannot be parsed."""
    try:
        return urlsplit(url)
    except ValueError:
        return urlsplit("")


class TimedProtocol(H11Protocol):
    """uvicorn itself waits without a limit for the rest of a request that has begun."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        super().connection_made(transport)
        self._expect_request()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._expect_request()

    def _expect_request(self) -> None:
        self.loop.call_later(REQUEST_SECONDS, self._close_if_idle, self.cycle)

    def _close_if_idle(self, last: Any) -> None:
        if self.cycle is last:
            self.transport.close()
