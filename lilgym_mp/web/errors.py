"""One style of error: JSON under /api, a page elsewhere, each with the status code that says what was wrong."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from sqlalchemy.exc import OperationalError
from starlette.exceptions import HTTPException

from lilgym_mp.web.templating import page

LOGGER = logging.getLogger(__name__)
MOST_FAULTS = 10  # fields at fault that are told


class FieldFault(BaseModel):
    """Which part of a request is wrong, and why."""

    field: str
    message: str


class ErrorBody(BaseModel):
    """Every answer under /api with a status of 400 or more."""

    status: int
    message: str
    fields: list[FieldFault] = []


ERROR_RESPONSES: dict[int | str, dict[str, Any]] = {
    status: {"model": ErrorBody, "description": HTTPStatus(status).phrase}
    for status in (400, 401, 403, 404, 405, 409, 413, 422, 429, 503)
}


def refusal(status: int, message: str) -> HTTPException:
    """The exception that answers a request with an error."""
    return HTTPException(status, message)


def error_response(request: Request, status: int, message: str, fields: Sequence[FieldFault] = ()) -> Response:
    """The answer that tells of an error, in the form that the request's path calls for."""
    if request.url.path.startswith("/api/") or request.url.path == "/openapi.json":
        body = ErrorBody(status=status, message=message, fields=list(fields))
        return JSONResponse(body.model_dump(), status)
    title = HTTPStatus(status).phrase
    return page(request, "error.html", status=status, title=title, message=message, status_code=status)


def add_error_handlers(app: FastAPI) -> None:
    app.add_exception_handler(HTTPException, _told)
    app.add_exception_handler(RequestValidationError, _misread)
    app.add_exception_handler(OperationalError, _unavailable)
    app.add_exception_handler(Exception, _unforeseen)


def _told(request: Request, fault: Any) -> Response:
    message = str(fault.detail)
    if message == HTTPStatus(fault.status_code).phrase:  # the framework's own words
        message = {
            HTTPStatus.NOT_FOUND: f"there is nothing at {request.url.path}",
            HTTPStatus.METHOD_NOT_ALLOWED: f"{request.url.path} does not take {request.method} requests",
        }.get(HTTPStatus(fault.status_code), message)
    response = error_response(request, fault.status_code, message)
    response.headers.update(fault.headers or {})
    return response


def _misread(request: Request, fault: Any) -> Response:
    fields = [
        FieldFault(field=".".join(map(str, error["loc"])), message=str(error["msg"]))
        for error in fault.errors()[:MOST_FAULTS]
    ]
    message = "; ".join(f"{field.field}: {field.message}" for field in fields)
    return error_response(request, 422, message or "the request is not as it must be", fields)


def _unavailable(request: Request, fault: Any) -> Response:
    LOGGER.error("database: %s", fault.orig)
    return error_response(request, 503, "the database did not answer; nothing was saved: try again")


def _unforeseen(request: Request, fault: Exception) -> Response:
    LOGGER.error("%s %s failed", request.method, request.url.path, exc_info=fault)
    return error_response(request, 500, "something went wrong in the server; nothing was saved")
