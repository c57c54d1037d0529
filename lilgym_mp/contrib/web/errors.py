"""Error responses: JSON under /api, an HTML page elsewhere."""

from __future__ import annotations

import logging
import sqlite3
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from lilgym_mp.contrib.web.templating import render_page

LOGGER = logging.getLogger(__name__)
MAX_FIELD_ERRORS = 10  # validation errors reported in one response


class ErrorBody(BaseModel):
    """Body of every response under /api with a status of 400 or more."""

    status: int
    message: str


ERROR_RESPONSES: dict[int | str, dict[str, Any]] = {
    status: {"model": ErrorBody, "description": HTTPStatus(status).phrase}
    for status in (400, 401, 403, 404, 405, 409, 413, 422, 503)
}


def http_error(status: int, message: str) -> HTTPException:
    """Exception to raise in a route to respond with this error."""
    return HTTPException(status, message)


def error_response(request: Request, status: int, message: str) -> Response:
    """A JSON or HTML error response, depending on the request's path."""
    if request.url.path.startswith("/api/") or request.url.path == "/openapi.json":
        body = ErrorBody(status=status, message=message)
        return JSONResponse(body.model_dump(), status)
    title = HTTPStatus(status).phrase
    return render_page(request, "error.html", status=status, title=title, message=message, status_code=status)


def add_error_handlers(app: FastAPI) -> None:
    app.add_exception_handler(HTTPException, _handle_http_exception)
    app.add_exception_handler(RequestValidationError, _handle_validation_error)
    app.add_exception_handler(sqlite3.OperationalError, _handle_database_error)
    app.add_exception_handler(Exception, _handle_unexpected_error)


def _handle_http_exception(request: Request, fault: Any) -> Response:
    message = str(fault.detail)
    if message == HTTPStatus(fault.status_code).phrase:  # the framework's default message
        message = {
            HTTPStatus.NOT_FOUND: f"there is nothing at {request.url.path}",
            HTTPStatus.METHOD_NOT_ALLOWED: f"{request.url.path} does not accept {request.method} requests",
        }.get(HTTPStatus(fault.status_code), message)
    response = error_response(request, fault.status_code, message)
    response.headers.update(fault.headers or {})
    return response


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
