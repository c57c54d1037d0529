"""Downloads a small file over HTTP with pooch, limited in time and size."""

from __future__ import annotations

import threading
from importlib import import_module
from pathlib import Path
from typing import IO, Any, NamedTuple
from urllib.parse import urlsplit

from lilgym_mp.corpus.faults import CorpusError, InterruptionError
from lilgym_mp.corpus.records import MAX_BYTES

HEADERS = {"User-Agent": "lilgym_mp (data download)", "Accept-Encoding": "identity"}
SCHEMES = ("http", "https")
OK = 200
RETRIED_STATUS = (408, 425, 429)  # and all from 500
MAX_REASON = 200  # characters of a library's or server's message


class Limits(NamedTuple):
    """How long a download may take."""

    tries: int = 4  # pooch waits 1, 2, 3, ... seconds between them
    seconds: float = 300.0  # for one try
    silence: float = 30.0  # seconds without a byte


LIMITS = Limits()


class _RefusalError(Exception):
    """A response for which trying again is useless. Not a ValueError, which pooch would try again."""


def checked_url(url: str) -> str:
    """`url` if its scheme is supported. Raises CorpusError otherwise."""
    parts = urlsplit(url)
    if parts.scheme not in SCHEMES or not parts.netloc:
        schemes = " or ".join(f"{scheme}://" for scheme in SCHEMES)
        raise CorpusError(f"cannot download from {url!r}; a URL must start with {schemes}")
    return url


def fetch(url: str, path: Path, limits: Limits = LIMITS) -> None:
    """Downloads `url` to `path`, which appears only when complete.

    Raises InterruptionError after the last try, CorpusError when the server refuses, OSError when `path` cannot be
    written.
    """
    from requests import RequestException

    pooch: Any = import_module("pooch")  # untyped

    checked_url(url)
    pooch.get_logger().setLevel("ERROR")
    files = pooch.create(
        path.parent, "", registry={path.name: None}, urls={path.name: url}, retry_if_failed=limits.tries - 1
    )
    try:
        files.fetch(path.name, downloader=_Downloader(limits))
    except _RefusalError as error:
        raise CorpusError(f"{url}: {error}") from None
    except (RequestException, ValueError) as error:
        host = urlsplit(url).netloc
        raise InterruptionError(f"{host}: {_reason(error)} (tries: {limits.tries}; {url})") from None


class _Downloader:
    """pooch's HTTP downloader with a limit of bytes and of seconds in all.

    The latter needs a thread: a server that sends a byte now and then never exceeds the time limit of one read.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits

    def __call__(self, url: str, output_file: str, pooch: Any) -> None:
        from requests import Timeout

        errors: list[BaseException] = []
        with open(output_file, "wb") as file:
            sink = _Sink(file)
            thread = threading.Thread(target=self._download, args=(url, sink, errors), daemon=True)
            thread.start()
            thread.join(self._limits.seconds)
            if thread.is_alive():
                sink.is_open = False
                raise Timeout(f"not complete after {self._limits.seconds:g} seconds")
        if errors:
            raise errors[0]

    def _download(self, url: str, sink: _Sink, errors: list[BaseException]) -> None:
        from requests.exceptions import InvalidSchema, InvalidURL, TooManyRedirects

        responses: list[Any] = []  # pooch does not close them after an error

        def check(response: Any, *args: Any, **options: Any) -> None:
            responses.append(response)
            _check_status(response)

        options = {"timeout": self._limits.silence, "headers": HEADERS, "hooks": {"response": check}}
        try:
            import_module("pooch").HTTPDownloader(chunk_size=1 << 16, **options)(url, sink, None)
        except (InvalidSchema, InvalidURL, TooManyRedirects) as error:
            errors.append(_RefusalError(_reason(error)))
        except Exception as error:
            errors.append(error)
        finally:
            for response in responses:
                response.close()


def _check_status(response: Any) -> None:
    """Raises _RefusalError for a response that is neither the file, nor a redirect, nor worth another try."""
    status = response.status_code
    if response.headers.get("X-RateLimit-Remaining") == "0" and status != OK:
        raise _RefusalError("rate limit exceeded; try again in an hour")
    is_redirected = response.is_redirect and response.headers["Location"]
    if not (status == OK or is_redirected or status >= 500 or status in RETRIED_STATUS):
        raise _RefusalError(f"the server answers {status} {response.reason}")


class _Sink:
    """A file that refuses too many bytes, and any after it was closed."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self._count = file, 0
        self.is_open = True

    def write(self, data: bytes) -> None:
        self._count += len(data)
        if self._count > MAX_BYTES or not self.is_open:
            raise _RefusalError(f"sends more than {MAX_BYTES} bytes, more than any file of the release")
        self._file.write(data)

    def flush(self) -> None:
        """Called by pooch after each write."""


def _reason(error: BaseException) -> str:
    """The message of the innermost error in one of requests, on one line."""
    while causes := [part for part in (*error.args, getattr(error, "reason", None)) if isinstance(part, Exception)]:
        error = causes[-1]
    return " ".join(str(error).split())[:MAX_REASON] or type(error).__name__
