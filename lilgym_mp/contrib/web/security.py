"""Middleware for every request: security headers, allowed hosts and origins, body size, the access token."""

from __future__ import annotations

import hmac
from urllib.parse import SplitResult, urlencode, urlsplit

from fastapi import HTTPException, Request, Response
from fastapi.responses import RedirectResponse
from starlette.datastructures import Headers
from starlette.middleware.base import RequestResponseEndpoint

from lilgym_mp.contrib.web.app_services import ServeOptions
from lilgym_mp.contrib.web.responses import error_response

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
TOKEN_COOKIE = "lilgym_token"
PUBLIC_PATHS = "/assets/"  # served without the token
MAX_BODY = 256 * 1024  # bytes
SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


async def guard(options: ServeOptions, request: Request, call_next: RequestResponseEndpoint) -> Response:
    """Refuses a request that breaks a rule, and adds headers to every response."""
    try:
        _check_host(request.headers, options.hosts)
        response: Response | None = None if options.token is None else _check_token(request, options.token)
        if request.method not in SAFE_METHODS:
            _check_origin(request.headers)
            _check_length(request.headers)
    except HTTPException as refusal:
        response = error_response(request, refusal.status_code, refusal.detail)
        response.headers.update(refusal.headers or {})
    response = response or await call_next(request)
    for name, value in SECURITY_HEADERS.items():
        response.headers.setdefault(name, value)
    return response


def _check_host(headers: Headers, hosts: tuple[str, ...] | None) -> None:
    """Raises HTTPException for an unknown Host header, which protects against DNS rebinding."""
    host = headers.get("host", "")
    if hosts is not None and (_split(f"//{host}").hostname or "") not in hosts:
        raise HTTPException(400, f"this server does not answer to the host name {host[:100]!r}")


def _check_token(request: Request, expected: str) -> RedirectResponse | None:
    """Raises HTTPException for a request without the access token, but for PUBLIC_PATHS.

    For a request with the token in its URL, returns a redirection to the URL without it, which sets a cookie.
    """
    token = request.query_params.get("token")
    given = request.cookies.get(TOKEN_COOKIE, "") if token is None else token
    if request.scope["path"].startswith(PUBLIC_PATHS):  # `request.url` may be made of the Host header
        return None
    if not hmac.compare_digest(given.encode(), expected.encode()):
        wrong = "the link's token is wrong" if token is not None else "this server needs a token"
        raise HTTPException(401, f"{wrong}: open the link that it printed when it started")
    if token is None:
        return None
    query = urlencode([(name, value) for name, value in request.query_params.multi_items() if name != "token"])
    path = "/" + request.scope["path"].lstrip("/")  # not "//host", which would lead elsewhere
    response = RedirectResponse(f"{path}?{query}" if query else path, 303)
    response.set_cookie(TOKEN_COOKIE, expected, max_age=400 * 24 * 3600, httponly=True)
    return response


def _check_origin(headers: Headers) -> None:
    """Raises HTTPException for a request sent by a page of another server, of which browsers tell (CSRF)."""
    origin, site = headers.get("origin"), headers.get("sec-fetch-site", "none")
    is_other = origin is not None and _split(origin).netloc != headers.get("host", "")
    if is_other or site not in ("same-origin", "none"):
        raise HTTPException(403, "this request was not sent from a page of this server")


def _check_length(headers: Headers) -> None:
    """Raises HTTPException for a body that is too long, or does not say how long it is."""
    length = headers.get("content-length", "0")
    if "transfer-encoding" in headers or not length.isdecimal() or int(length[:20]) > MAX_BODY:
        reason = f"the body of this request may have at most {MAX_BODY:,} bytes, by its Content-Length"
        raise HTTPException(413, reason, {"Connection": "close"})


def _split(url: str) -> SplitResult:
    """The parts of a URL; empty if it cannot be parsed."""
    try:
        return urlsplit(url)
    except ValueError:
        return urlsplit("")
