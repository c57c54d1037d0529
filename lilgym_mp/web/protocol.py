"""HTTP connections that are closed unless each request arrives in time."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

REQUEST_SECONDS = 30.0  # until the headers of a request are complete, from the connection or the last response


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
