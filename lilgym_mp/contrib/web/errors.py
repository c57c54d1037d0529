"""Error responses: JSON under /api, an HTML page elsewhere."""

from __future__ import annotations

import logging
import sqlite3
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, HTTPException, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException as FrameworkException

from lilgym_mp.contrib.web.templating import render_page
from lilgym_mp.corpus import CorpusError
from lilgym_mp.programs import ProgramError
from lilgym_mp.scene.actions import ActionError
from lilgym_mp.solver.solver import UnsupportedAppearance

LOGGER = logging.getLogger(__name__)
STATUSES = {ActionError: 422, ProgramError: 422, CorpusError: 404, UnsupportedAppearance: 404}
"""Exceptions that routes let pass, with the status of the response; the message is theirs."""
MAX_FIELD_ERRORS = 10  # validation errors reported in one response


def http_error(status: int, message: str) -> HTTPException:
    """Exception to raise in a route to respond with this error."""
    return HTTPException(status, message)


def error_response(request: Request, status: int, message: str) -> Response:
    """A JSON or HTML error response, depending on the request's path."""
    if request.url.path.startswith("/api/") or request.url.path == "/openapi.json":
        return JSONResponse({"status": status, "message": message}, status)
    title = HTTPStatus(status).phrase
    return render_page(request, "error.html", status_code=status, title=title, message=message)


def add_error_handlers(app: FastAPI) -> None:
    app.add_exception_handler(FrameworkException, _handle_http_exception)
    for kind in STATUSES:
        app.add_exception_handler(kind, _handle_refusal)
    app.add_exception_handler(RequestValidationError, _handle_validation_error)
    app.add_exception_handler(sqlite3.OperationalError, _handle_database_error)
    app.add_exception_handler(Exception, _handle_unexpected_error)


def _handle_http_exception(request: Request, fault: Any) -> Response:
    message, path = str(fault.detail), request.url.path
    if message == HTTPStatus.NOT_FOUND.phrase:  # the framework's default message
        message = f"there is nothing at {path}"
    elif message == HTTPStatus.METHOD_NOT_ALLOWED.phrase:
        message = f"{path} does not accept {request.method} requests"
    response = error_response(request, fault.status_code, message)
    response.headers.update(fault.headers or {})
    return response


def _handle_refusal(request: Request, fault: Exception) -> Response:
    status = next(status for kind, status in STATUSES.items() if isinstance(fault, kind))
    return error_response(request, status, str(fault))


def _handle_validation_error(request: Request, fault: Any) -> Response:
    errors = fault.errors()[:MAX_FIELD_ERRORS]
    message = "; ".join(f"{'.'.join(map(str, error['loc']))}: {error['msg']}" for error in errors)
    return error_response(request, 422, message or "the request is malformed")


def _handle_database_error(request: Request, fault: Any) -> Response:
    LOGGER.error("database: %s", fault)
    return error_response(request, 503, "the database is not responding; nothing was saved: try again")


def _handle_unexpected_error(request: Request, fault: Exception) -> Response:
    LOGGER.error("%s %s failed", request.method, request.url.path, exc_info=fault)
    return error_response(request, 500, "something went wrong on the server; nothing was saved")
