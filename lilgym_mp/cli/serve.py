"""Play, watch agents, annotate and explore in the browser.

Serves a web application on which to play tasks, watch recorded agents, play the two-agent game, annotate statements
with programs and explore a corpus. All data stay on this machine; Ctrl-C stops it.
"""

from __future__ import annotations

import argparse
import ipaddress
import re
import secrets
import socket
import sys
import threading
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from lilgym_mp.cli.options import RUNS, CommandError, add_corpus, add_flag, add_number

if TYPE_CHECKING:
    from fastapi import FastAPI

PORT = 8000
DATABASE = Path("lilgym-web.sqlite3")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `lilgym-mp serve`."""
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen on (default: %(default)s); other than loopback, visitors need the token",
    )
    add_number(parser, "--port", PORT, "port, 0 for any free one")
    add_corpus(parser)
    parser.add_argument(
        "--database",
        type=Path,
        default=DATABASE,
        metavar="FILE",
        help="SQLite file with played episodes and annotations (default: %(default)s)",
    )
    parser.add_argument(
        "--runs",
        type=Path,
        metavar="DIR",
        help=f"directory with training runs and recorded episodes (default: {RUNS}, if it exists)",
    )
    parser.add_argument(
        "--token",
        help="token that visitors need, part of the printed link (default: a random one beyond loopback, else none)",
    )
    parser.add_argument(
        "--host-name",
        action="append",
        default=[],
        metavar="NAME",
        help="name under which a reverse proxy serves the pages; may be given several times",
    )
    add_flag(parser, "--open", "open the page in a browser")


def run(args: argparse.Namespace) -> int:
    """Serves the pages until interrupted; visitors from other machines need a token."""
    from lilgym_mp.contrib.web.app import create_app
    from lilgym_mp.contrib.web.app_services import LOOPBACK_HOSTS, ServeOptions

    if args.runs is not None and not args.runs.is_dir():
        raise CommandError(f"--runs {args.runs}: there is no such directory")
    runs = args.runs or (RUNS if RUNS.is_dir() else None)
    if args.token is not None and not re.fullmatch(r"[\w-]{8,200}", args.token, re.ASCII):
        raise CommandError("--token must be 8 to 200 letters, digits, '-' and '_'; leave it out for a random one")
    with _listen(args.host, args.port) as listening:
        address, port = listening.getsockname()[:2]
        is_local = ipaddress.ip_address(address).is_loopback
        token = args.token or (None if is_local else secrets.token_urlsafe(24))
        hosts = (*LOOPBACK_HOSTS, args.host) if is_local else None
        app = create_app(ServeOptions(args.corpus, args.database, runs, token, hosts, tuple(args.host_name)))
        _serve(app, listening, link=_link(args.host, port, token), opens=args.open)
    return 0


def _listen(host: str, port: int) -> socket.socket:
    """A listening socket. Raises CommandError with the reason if that fails."""
    if not 0 <= port < 65536:
        raise CommandError(f"--port must be in 0 .. 65535, not {port}")
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        is_dual = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
        return socket.create_server(address, family=family, backlog=2048, dualstack_ipv6=is_dual)
    except OSError as error:
        reason = f"{str(error.strerror).partition(' (')[0]}; choose another with --port, or 0 for any free one"
        raise CommandError(f"cannot listen on {host}, port {port}: {reason}") from None


def _link(host: str, port: int, token: str | None) -> str:
    name = _own_address() if host in ("", "0.0.0.0", "::") else host
    query = "" if token is None else f"/?token={token}"
    return f"http://{f'[{name}]' if ':' in name else name}:{port}{query}"


def _own_address() -> str:
    """The address by which other machines reach this one; loopback if it has no network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # reserved for documentation; connecting a datagram socket sends nothing
            return probe.getsockname()[0]
        except OSError:
            return "127.0.0.1"


def _serve(app: FastAPI, listening: socket.socket, *, link: str, opens: bool) -> None:
    """Serves until Ctrl-C or SIGTERM."""
    import uvicorn

    class Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            print(f"serving at {link}\nCtrl-C stops it", flush=True)
            if opens:
                threading.Thread(target=webbrowser.open, args=[link]).start()

    # Loads the tasks, so that the first page that lists tasks need not wait for them.
    threading.Thread(target=app.state.services.sizes, daemon=True).start()
    config = uvicorn.Config(
        app,
        proxy_headers=False,
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=3,
        timeout_keep_alive=30,
    )
    with suppress(KeyboardInterrupt):  # raised again by uvicorn once all connections are closed
        Server(config).run(sockets=[listening])
    print("stopped", file=sys.stderr)
