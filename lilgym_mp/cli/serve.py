"""Play, watch agents, annotate and explore in the browser.

Serves a web application on which to play tasks, watch recorded agents, play the two-agent game, annotate statements
with programs and explore a corpus. All data stay on this machine; Ctrl-C stops it.
"""

from __future__ import annotations

import argparse
import errno
import ipaddress
import socket
import sys
import threading
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from lilgym_mp.extras import install
from lilgym_mp.options import RUNS, CommandError, add_corpus

if TYPE_CHECKING:
    import uvicorn
    from fastapi import FastAPI

PORT, DATABASE = 8000, "lilgym-web.sqlite3"
WEB_PACKAGES = ("fastapi", "starlette", "uvicorn", "jinja2", "sqlalchemy", "alembic", "pydantic", "anyio")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen on (default: %(default)s); other than loopback, visitors need a token",
    )
    parser.add_argument("--port", type=int, default=PORT, help="port, 0 for any free one (default: %(default)s)")
    add_corpus(parser)
    parser.add_argument(
        "--database",
        default=DATABASE,
        metavar="FILE_OR_URL",
        help="SQLite file, or URL of a PostgreSQL database (default: %(default)s)",
    )
    parser.add_argument(
        "--runs",
        type=Path,
        metavar="DIR",
        help=f"directory with training runs and recorded episodes (default: {RUNS}, if it exists)",
    )
    parser.add_argument(
        "--trusted-proxy",
        action="append",
        default=[],
        metavar="ADDRESS",
        help="reverse proxy whose X-Forwarded-For and X-Forwarded-Proto are believed; every visitor then needs a token",
    )
    parser.add_argument("--open", action="store_true", help="open the page in a browser")


def run(args: argparse.Namespace) -> int:
    try:
        from lilgym_mp.web.app import create_app
        from lilgym_mp.web.app_services import LOOPBACK_HOSTS, ServeOptions, database_url
    except ModuleNotFoundError as error:
        if error.name not in WEB_PACKAGES:
            raise
        raise CommandError(f"needs {error.name}: {install('web')}") from None
    if args.runs is not None and not args.runs.is_dir():
        raise CommandError(f"--runs {args.runs}: there is no such directory")
    runs = args.runs or (RUNS if RUNS.is_dir() else None)
    listening = _listen(args.host, args.port)
    with listening:
        is_local = ipaddress.ip_address(listening.getsockname()[0]).is_loopback and not args.trusted_proxy
        options = ServeOptions(
            corpus=args.corpus,
            database=database_url(args.database),
            runs=runs,
            requires_tokens=not is_local,
            hosts=(*LOOPBACK_HOSTS, args.host) if is_local else None,
        )
        url = _url(args.host, listening.getsockname()[1])
        _serve(create_app(options), listening, url=url, is_local=is_local, args=args)
    return 0


def _listen(host: str, port: int) -> socket.socket:
    """A listening socket. Raises CommandError with the reason if that fails."""
    if not 0 <= port < 65536:
        raise CommandError(f"--port must be in 0 .. 65535, not {port}")
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except socket.gaierror as error:
        raise CommandError(f"--host {host}: {error.strerror}") from None
    try:
        is_dual = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
        return socket.create_server(address, family=family, backlog=2048, dualstack_ipv6=is_dual)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise CommandError(f"port {port} is in use; choose another with --port, or 0 for any free one") from None
        raise CommandError(f"cannot listen on {host}, port {port}: {error.strerror}") from None


def _url(host: str, port: int) -> str:
    name = host if host not in ("0.0.0.0", "::") else socket.gethostname()
    return f"http://{f'[{name}]' if ':' in name else name}:{port}"


def server_config(app: FastAPI, proxies: list[str]) -> uvicorn.Config:
    """`proxies`: addresses of the reverse proxies whose headers are believed."""
    import uvicorn

    from lilgym_mp.web.security import TimedProtocol

    return uvicorn.Config(
        app,
        http=TimedProtocol,
        proxy_headers=bool(proxies),
        forwarded_allow_ips=proxies,
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=3,
        timeout_keep_alive=30,
    )


def _serve(app: FastAPI, listening: socket.socket, *, url: str, is_local: bool, args: argparse.Namespace) -> None:
    """Serves until Ctrl-C or SIGTERM."""
    import uvicorn

    from lilgym_mp.web.authentication import issue_operator_token

    with app.state.services.database.write_session() as session:
        token = issue_operator_token(session)
    organiser_url = f"{url}/login?token={token}"

    class Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            print(f"serving at        {url}\norganiser's link  {organiser_url}\nCtrl-C stops it", flush=True)
            if args.open:
                threading.Thread(target=webbrowser.open, args=[url if is_local else organiser_url]).start()

    # Warms up the catalogue, so that the first page that lists tasks need not wait for them to load.
    threading.Thread(target=app.state.services.catalogue.sizes, daemon=True).start()
    with suppress(KeyboardInterrupt):  # raised again by uvicorn once all connections are closed
        Server(server_config(app, args.trusted_proxy)).run(sockets=[listening])
    print("stopped", file=sys.stderr)
