"""Errors as RFC 9457 problem+json: what can go wrong, and how each is told to the client."""

import logging
from collections.abc import Mapping
from http import HTTPStatus
from typing import NamedTuple

from asgi_correlation_id import correlation_id
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, HTTPConnection

from app.api.body import AS_IT_IS, JSON, UnsupportedContentEncoding, UnsupportedContentType
from app.api.middleware import BodyTooLarge, BodyTooSlow
from app.inference.model_store import UnfitModel, UnknownModel
from app.planning.methods.base import InvalidStepCount
from app.planning.problem import PlanningError
from app.serving.refusals import (
    ClientGone,
    DeadlineExceeded,
    InvalidField,
    InvalidFields,
    NotReady,
    OutOfOrder,
    Refused,
    ShuttingDown,
)
from app.wire.field_errors import field_errors
from app.wire.json_text import InvalidParts, NestedTooDeeply, NotJson, NotUtf8
from app.wire.problems import FieldError, ProblemDetails


class MalformedHttp(HTTPException):
    """What a connection brought is not HTTP as we know it."""


log = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"
RETRY_AFTER_SECONDS = "1"
UNEXPECTED = "an unexpected error; the server's log tells more"


def problem_response(
    request: HTTPConnection,
    status: int,
    detail: str,
    *,
    slug: str | None = None,
    title: str | None = None,
    errors: list[FieldError] | None = None,
    headers: dict[str, str] | None = None,
) -> Response:
    """Build a problem+json answer; `slug` names the type, `about:blank` where there is none."""
    problem = _problem(request.url.path, status, detail, slug, title, errors)
    return _response(problem, headers)


def _problem(
    path: str,
    status: int,
    detail: str,
    slug: str | None = None,
    title: str | None = None,
    errors: list[FieldError] | None = None,
) -> ProblemDetails:
    return ProblemDetails(
        type=f"urn:breakaway:problem:{slug}" if slug else "about:blank",
        title=title or HTTPStatus(status).phrase,
        status=status,
        detail=detail,
        instance=path,
        errors=errors,
    )


def _response(problem: ProblemDetails, headers: dict[str, str] | None = None) -> Response:
    text = problem.model_dump_json(exclude_none=True)
    return Response(text, problem.status, headers, media_type=MEDIA_TYPE)


def field_problem(path: str, errors: list[FieldError]) -> ProblemDetails:
    """Say 422 of fields at fault."""
    detail = "; ".join(f"{error.pointer or 'the body'}: {error.detail}" for error in errors)
    return _problem(path, 422, detail, "invalid-request", "Invalid request", errors)


class Answer(NamedTuple):
    """How an error is told."""

    status: int
    slug: str | None = None
    title: str | None = None
    rejected: str | None = None
    """Why there is no plan, for log and metrics."""
    headers: Mapping[str, str] = {}
    """What the client does better next time, or when."""


NOT_READY = Answer(
    503, "not-ready", rejected="not_ready", headers={"Retry-After": RETRY_AFTER_SECONDS}
)
# Told to nobody; the status, which others use for it too, is for log and metrics.
CLIENT_GONE = Answer(499, title="Client gone", rejected="client_gone")
ANSWERS: dict[type[Exception], Answer] = {
    NotJson: Answer(400, "not-json", "Not JSON"),
    NotUtf8: Answer(400, "not-utf-8", "Not UTF-8"),
    NestedTooDeeply: Answer(400, "nested-too-deeply", "Nested too deeply"),
    BodyTooSlow: Answer(408, "body-too-slow", headers={"Connection": "close"}),
    BodyTooLarge: Answer(413, "body-too-large"),
    UnsupportedContentType: Answer(415, "unsupported-content-type", headers={"Accept": JSON}),
    UnsupportedContentEncoding: Answer(
        415, "unsupported-content-encoding", headers={"Accept-Encoding": AS_IT_IS}
    ),
    UnknownModel: Answer(404, "unknown-model", "Unknown model"),
    PlanningError: Answer(500, "planning-failed", "Planning failed"),
    Refused: Answer(429, "busy"),
    OutOfOrder: Answer(409, "out-of-order", "Out of order"),
    NotReady: NOT_READY,
    ShuttingDown: NOT_READY,
    DeadlineExceeded: Answer(504, "deadline-exceeded", rejected="deadline_exceeded"),
    ClientGone: CLIENT_GONE,
    ClientDisconnect: CLIENT_GONE,
}
FIELDS: dict[type[Exception], str] = {
    InvalidStepCount: "/method/steps",
    UnfitModel: "/system",
    InvalidField: "",
    InvalidFields: "",
}
"""Errors that are a field's, with its pointer where they do not bring their own."""


def problem_of(error: Exception, path: str) -> ProblemDetails:
    """Return how an error is told to who asked for `path`; what nobody foresaw is a 500."""
    if isinstance(error, InvalidParts | InvalidFields):
        return field_problem(path, error.errors)
    if type(error) in FIELDS:
        pointer = error.pointer if isinstance(error, InvalidField) else FIELDS[type(error)]
        return field_problem(path, [FieldError(pointer=pointer, detail=str(error))])
    answer = _answer_to(error)
    if answer is None:
        return _problem(path, 500, UNEXPECTED)
    return _problem(path, answer.status, str(error), answer.slug, answer.title)


def refusal_of(error: Exception, request: HTTPConnection) -> Response:
    """Answer a request that is refused, with what its client does better next time, or when."""
    answer = _answer_to(error)
    headers = dict(answer.headers) if answer else {}
    if isinstance(error, Refused):
        headers["Retry-After"] = str(error.retry_after_s)
    return _response(problem_of(error, request.url.path), headers)


def rejected_of(error: Exception) -> str | None:
    """Return why there is no answer, for log and metrics."""
    answer = _answer_to(error)
    return error.reason if isinstance(error, Refused) else answer and answer.rejected


def _answer_to(error: Exception) -> Answer | None:
    return next((ANSWERS[kind] for kind in type(error).__mro__ if kind in ANSWERS), None)


def install_error_handlers(app: FastAPI) -> None:
    """Make every error of `app` a problem+json answer, never a traceback."""
    app.add_exception_handler(RequestValidationError, _invalid_request)
    app.add_exception_handler(InvalidParts, _invalid_field)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(MalformedHttp, answer_malformed_http)
    app.add_exception_handler(Exception, _unexpected)
    for kind in ANSWERS:
        app.add_exception_handler(kind, _answer)
    for kind in FIELDS:
        app.add_exception_handler(kind, _invalid_field)


async def answer_malformed_http(request: Request, error: Exception) -> Response:
    """Tell what was wrong with a request's head or body; no other follows on its connection."""
    assert isinstance(error, MalformedHttp)
    request.state.log_fields["malformed"] = error.detail
    return problem_response(
        request,
        error.status_code,
        f"the request cannot be read: {error.detail}",
        slug="malformed-http",
        title="Malformed HTTP",
        headers={"Connection": "close"},
    )


async def _answer(request: Request, error: Exception) -> Response:
    rejected = rejected_of(error)
    if rejected and request.method == "POST":  # a plan, and not a probe
        request.state.log_fields["rejected"] = rejected
    return refusal_of(error, request)


async def _invalid_field(request: Request, error: Exception) -> Response:
    return _response(problem_of(error, request.url.path))


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    detail = str(error.detail)
    if error.status_code == HTTPStatus.NOT_FOUND and request.url.path.endswith("/"):
        detail = "there is nothing here; no path ends with a slash"
    return problem_response(request, error.status_code, detail, headers=headers)


async def _unexpected(request: Request, _: Exception) -> Response:
    # Answered outside of the middleware that puts the id into every other answer, and followed by
    # the connection's end, because uvicorn sees the error, too.
    headers = {"X-Request-ID": correlation_id.get() or "", "Connection": "close"}
    return problem_response(request, 500, UNEXPECTED, headers=headers)  # uvicorn logs it


async def _invalid_request(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    within_body = [item | {"loc": item["loc"][1:]} for item in error.errors()]
    errors = field_errors(within_body, error.body)
    return _response(field_problem(request.url.path, errors))
