"""Downloads a small file over HTTP, limited in time and size."""

from __future__ import annotations

import threading
import time
from contextlib import closing
from http.client import HTTPException, IncompleteRead, InvalidURL
from typing import Any, NamedTuple
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import HTTPRedirectHandler, Request, build_opener

from lilgym_mp.corpus.faults import CorpusError, InterruptionError
from lilgym_mp.corpus.records import MAX_BYTES

HEADERS = {"User-Agent": "lilgym_mp (data download)", "Accept-Encoding": "identity"}
SCHEMES = ("http", "https")
OK = 200
RETRIED_STATUS = (408, 425, 429)  # and all from 500
MAX_REASON = 200  # characters of a library's or server's message


class Limits(NamedTuple):
    """How long a download may take."""

    tries: int = 4  # with pauses of 1, 2, 3, ... seconds between them
    seconds: float = 300.0  # for one try
    silence: float = 30.0  # seconds without a byte


LIMITS = Limits()


def checked_url(url: str) -> str:
    """`url` if its scheme is supported. Raises CorpusError otherwise."""
    parts = urlsplit(url)
    if parts.scheme not in SCHEMES or not parts.netloc:
        schemes = " or ".join(f"{scheme}://" for scheme in SCHEMES)
        raise CorpusError(f"cannot download from {url!r}; a URL must start with {schemes}")
    return url


def fetch(url: str, limits: Limits = LIMITS) -> bytes:
    """The content of the URL. Raises InterruptionError after the last try, CorpusError when the server refuses."""
    checked_url(url)
    reason = ""
    for attempt in range(limits.tries):
        if attempt:
            time.sleep(attempt)
        # Each try has a thread: a server that sends a byte now and then never exceeds the time limit of one read.
        found: list[bytes | Exception] = []
        thread = threading.Thread(target=_download, args=(url, limits.silence, found), daemon=True)
        thread.start()
        thread.join(limits.seconds)
        result = found[0] if found else TimeoutError(f"not complete after {limits.seconds:g} seconds")
        if isinstance(result, bytes):
            return result
        reason = " ".join(str(getattr(result, "reason", result)).split())[:MAX_REASON] or type(result).__name__
        if isinstance(result, HTTPError):
            reason = f"the server answers {result.code} {reason}"
            if result.headers.get("X-RateLimit-Remaining") == "0":
                raise CorpusError(f"{url}: rate limit exceeded; try again in an hour")
            if result.code < 500 and result.code not in RETRIED_STATUS:
                raise CorpusError(f"{url}: {reason}")
        elif isinstance(result, InvalidURL) or not isinstance(result, OSError | HTTPException):
            raise CorpusError(f"{url}: {reason}")
    raise InterruptionError(f"{urlsplit(url).netloc}: {reason} (tries: {limits.tries}; {url})")


class _Redirection(HTTPRedirectHandler):
    """Follows redirects to URLs of the supported schemes, and closes the response also where it fails."""

    def redirect_request(self, req: Request, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Request | None:
        if urlsplit(newurl).scheme not in SCHEMES:
            raise HTTPError(newurl, code, f"with a redirect to {newurl!r}", headers, fp)
        return super().redirect_request(req, fp, code, msg, headers, newurl)

    def http_error_302(self, req: Request, fp: Any, code: int, msg: str, headers: Any) -> Any:
        with closing(fp):
            return super().http_error_302(req, fp, code, msg, headers)

    http_error_301 = http_error_303 = http_error_307 = http_error_308 = http_error_302


def _download(url: str, silence: float, found: list[bytes | Exception]) -> None:
    """Appends the content of the URL to `found`, or the exception that prevents it."""
    try:
        with build_opener(_Redirection).open(Request(url, headers=HEADERS), timeout=silence) as response:
            if response.status != OK:
                raise HTTPError(url, response.status, response.reason, response.headers, None)
            if response.headers.get("Content-Encoding", "identity") != "identity":
                raise ValueError("sends compressed data, which was not requested")
            content = response.read(MAX_BYTES + 1)
            if len(content) > MAX_BYTES:
                raise ValueError(f"sends more than {MAX_BYTES} bytes, more than any file of the release")
            missing = int(response.headers.get("Content-Length", len(content))) - len(content)
            if missing:
                raise IncompleteRead(content, missing)
        found.append(content)
    except Exception as error:
        if isinstance(error, HTTPError):
            error.close()
        found.append(error)
