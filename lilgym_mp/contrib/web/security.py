"""Middleware for every request: security headers, allowed hosts and origins, body size, the access token, visitors."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from typing import Annotated
from urllib.parse import SplitResult, urlencode, urlsplit

from fastapi import Depends, HTTPException, Request
from fastapi.responses import RedirectResponse
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lilgym_mp.contrib.web.app_services import ServeOptions
from lilgym_mp.contrib.web.responses import error_response

VISITOR_COOKIE = "lilgym_visitor"
_VISITOR_ID = re.compile(r"[A-Za-z0-9_-]{43}")
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
TOKEN_COOKIE = "lilgym_token"
PUBLIC_PATHS = "/assets/"  # served without the token
MAX_BODY = 256 * 1024  # bytes
COOKIE_ATTRIBUTES = f"; Path=/; Max-Age={400 * 24 * 3600}; HttpOnly; SameSite=Lax"
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


def proof_of(token: str) -> str:
    """A value that proves knowledge of the token without giving it away."""
    return hashlib.sha256(f"lilgym-mp token:{token}".encode()).hexdigest()


async def get_visitor(request: Request) -> str:
    """The id of a browser, known to it and the server alone."""
    return request.scope["visitor"]


CurrentVisitor = Annotated[str, Depends(get_visitor)]


class Guard:
    """Refuses requests that break a rule, identifies the visitor of the others, and adds headers to every response.

    Plain ASGI, not Starlette's BaseHTTPMiddleware: body bytes are counted as they arrive and nothing is buffered.
    """

    def __init__(self, app: ASGIApp, options: ServeOptions) -> None:
        self.app = app
        self._hosts = options.hosts
        self._token_proof = None if options.token is None else proof_of(options.token)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        request = Request(scope)
        cookie = request.cookies.get(VISITOR_COOKIE, "")
        is_new = _VISITOR_ID.fullmatch(cookie) is None
        visitor = scope["visitor"] = secrets.token_urlsafe(32) if is_new else cookie

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
                if is_new and message["status"] < 400 and not scope["path"].startswith(PUBLIC_PATHS):
                    headers.append("Set-Cookie", f"{VISITOR_COOKIE}={visitor}{COOKIE_ATTRIBUTES}")
            await send(message)

        try:
            self._check_host(request.headers)
            response = self._check_token(request)
            if request.method not in SAFE_METHODS:
                _check_origin(request.headers)
        except HTTPException as refusal:
            response = error_response(request, refusal.status_code, refusal.detail)
            response.headers.update(refusal.headers or {})
        else:
            if response is None:
                await self.app(scope, _limited(receive), send_with_headers)
                return
        await response(scope, receive, send_with_headers)

    def _check_host(self, headers: Headers) -> None:
        """Raises HTTPException for an unknown Host header, which protects against DNS rebinding."""
        host = headers.get("host", "")
        if self._hosts is not None and (_split(f"//{host}").hostname or "") not in self._hosts:
            raise HTTPException(400, f"this server does not answer to the host name {host[:100]!r}")

    def _check_token(self, request: Request) -> RedirectResponse | None:
        """Raises HTTPException for a request without the access token, if one is needed.

        For a request with the token in its URL, returns a redirection to the URL without it, which sets a cookie.
        """
        if self._token_proof is None or request.url.path.startswith(PUBLIC_PATHS):
            return None
        token = request.query_params.get("token")
        proof = request.cookies.get(TOKEN_COOKIE, "") if token is None else proof_of(token)
        if not hmac.compare_digest(proof.encode(), self._token_proof.encode()):
            wrong = "the link's token is wrong" if token is not None else "this server needs a token"
            raise HTTPException(401, f"{wrong}: open the link that it printed when it started")
        if token is None:
            return None
        query = urlencode([(name, value) for name, value in request.query_params.multi_items() if name != "token"])
        path = "/" + request.url.path.lstrip("/")  # not "//host", which would lead elsewhere
        response = RedirectResponse(f"{path}?{query}" if query else path, 303)
        response.headers.append("Set-Cookie", f"{TOKEN_COOKIE}={self._token_proof}{COOKIE_ATTRIBUTES}")
        return response


def _check_origin(headers: Headers) -> None:
    """Raises HTTPException for a request sent by a page of another server, of which browsers tell (CSRF)."""
    origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
    is_other = origin is not None and _split(origin).netloc != headers.get("host", "")
    if is_other or site not in ("same-origin", "none"):
        raise HTTPException(403, "this request was not sent from a page of this server")


def _limited(receive: Receive) -> Receive:
    """`receive` for a body of limited size; raises HTTPException beyond."""
    received = 0

    async def receive_limited() -> Message:
        nonlocal received
        message = await receive()
        received += len(message.get("body", b""))
        if received > MAX_BODY:
            reason = f"the body of this request may have at most {MAX_BODY:,} bytes"
            raise HTTPException(413, reason, {"Connection": "close"})
        return message

    return receive_limited


def _split(url: str) -> SplitResult:
    """The parts of a URL; empty if it cannot be parsed."""
    try:
        return urlsplit(url)
    except ValueError:
        return urlsplit("")
