"""Middleware for every request: security headers, allowed hosts and origins, body size, the access token."""

from __future__ import annotations

import hashlib
import hmac
from urllib.parse import SplitResult, urlencode, urlsplit

from fastapi import HTTPException, Request, Response
from fastapi.responses import RedirectResponse
from starlette.datastructures import Headers
from starlette.middleware.base import RequestResponseEndpoint

from lilgym_mp.contrib.web.app_services import ServeOptions
from lilgym_mp.contrib.web.responses import error_response

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
TOKEN_COOKIE = "lilgym_token_"  # followed by part of the token's digest
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
        _check_host(request.headers, options)
        response: Response | None = None if options.token is None else _check_token(request, options.token)
        if request.method not in SAFE_METHODS:
            _check_origin(request.headers, options.host_names)
            _check_length(request.headers)
    except HTTPException as refusal:
        response = error_response(request, refusal.status_code, refusal.detail)
        response.headers.update(refusal.headers or {})
    response = response or await _respond(request, call_next)
    for name, value in SECURITY_HEADERS.items():
        response.headers.setdefault(name, value)
    return response


async def _respond(request: Request, call_next: RequestResponseEndpoint) -> Response:
    """The response of a route: to HEAD, that of GET without its body; to a path that ends in "/", a redirection."""
    path = request.scope["path"]
    method = request.method
    if path.endswith("/") and path.strip("/") and method in SAFE_METHODS:
        return _redirection(request, f"../{path.rstrip('/').rpartition('/')[2]}", 307)
    if method != "HEAD":
        return await call_next(request)
    request.scope["method"] = "GET"
    response = await call_next(request)
    request.scope["method"] = method
    return Response(status_code=response.status_code, headers=dict(response.headers))


def _redirection(request: Request, target: str, status: int) -> RedirectResponse:
    """To a relative URL, with the query but for the token: a proxy may have changed host, scheme and path."""
    query = urlencode([(name, value) for name, value in request.query_params.multi_items() if name != "token"])
    return RedirectResponse(f"{target}?{query}" if query else target, status)


def _check_host(headers: Headers, options: ServeOptions) -> None:
    """Raises HTTPException for an unknown Host header, which protects against DNS rebinding."""
    host = headers.get("host", "")
    name = _split(f"//{host}").hostname or ""
    if options.hosts is not None and name not in (*options.hosts, *options.host_names):
        raise HTTPException(400, f"this server does not answer to {host[:100]!r}; name it with --host-name")


def _check_token(request: Request, expected: str) -> RedirectResponse | None:
    """Raises HTTPException for a request without the access token, but for PUBLIC_PATHS.

    For a request with the token in its URL, returns a redirection to the URL without it, which sets a cookie.
    """
    token = request.query_params.get("token")
    cookie = TOKEN_COOKIE + hashlib.sha256(expected.encode()).hexdigest()[:12]  # other servers of the host have theirs
    given = request.cookies.get(cookie, "") if token is None else token
    if request.scope["path"].startswith(PUBLIC_PATHS):  # `request.url` may be made of the Host header
        return None
    if not hmac.compare_digest(given.encode(), expected.encode()):
        wrong = "the link's token is wrong" if token is not None else "this server needs a token"
        raise HTTPException(401, f"{wrong}: open the link that it printed when it started")
    if token is None:
        return None
    response = _redirection(request, f"./{request.scope['path'].rpartition('/')[2]}", 303)
    is_secure = request.headers.get("x-forwarded-proto") == "https"
    response.set_cookie(cookie, expected, max_age=400 * 24 * 3600, httponly=True, secure=is_secure)
    return response


def _check_origin(headers: Headers, host_names: tuple[str, ...]) -> None:
    """Raises HTTPException for a request sent by a page of another server, of which browsers tell (CSRF).

    A page of another server cannot set X-Forwarded-Host, which a proxy that changes the Host header adds.
    """
    site = headers.get("sec-fetch-site", "none")
    origin = _split(headers.get("origin", ""))
    own = (headers.get("host", ""), headers.get("x-forwarded-host"))
    is_other = "origin" in headers and origin.netloc not in own and origin.hostname not in host_names
    if site not in ("same-origin", "none"):
        raise HTTPException(403, "this request was not sent from a page of this server")
    if is_other:
        name = (origin.hostname or "")[:100]
        reason = (
            f"this request was sent from a page of {name!r}; if a proxy serves this there, name it with --host-name"
        )
        raise HTTPException(403, reason)


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
