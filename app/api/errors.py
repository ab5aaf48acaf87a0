"""Errors as RFC 9457 problem+json: what can go wrong, and how each is told to the client."""

import math
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

from asgi_correlation_id import correlation_id
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from starlette.exceptions import HTTPException

from app.inference.model_store import UnfitModel, UnknownModel
from app.inference.solvers import InvalidStepCount
from app.planning.problem import PlanningError
from app.serving.admission import Refused
from app.serving.refusals import InvalidField, NotReady
from app.serving.workers import ClientGone, DeadlineExceeded, ShuttingDown
from app.wire.problems import FieldError, ProblemDetails

MEDIA_TYPE = "application/problem+json"
RETRY_AFTER_SECONDS = "1"


def problem_response(
    request: Request,
    status: int,
    detail: str,
    *,
    slug: str | None = None,
    title: str | None = None,
    errors: list[FieldError] | None = None,
    headers: dict[str, str] | None = None,
) -> Response:
    """Build a problem+json answer; `slug` names the type, `about:blank` where there is none."""
    problem = ProblemDetails(
        type=f"urn:breakaway:problem:{slug}" if slug else "about:blank",
        title=title or HTTPStatus(status).phrase,
        status=status,
        detail=detail,
        instance=request.url.path,
        errors=errors,
    )
    return Response(
        problem.model_dump_json(exclude_none=True), status, headers, media_type=MEDIA_TYPE
    )


def field_problem(request: Request, errors: list[FieldError]) -> Response:
    """Answer 422 for fields at fault."""
    detail = "; ".join(f"{error.pointer or 'the body'}: {error.detail}" for error in errors)
    return problem_response(
        request, 422, detail, slug="invalid-request", title="Invalid request", errors=errors
    )


def install_error_handlers(app: FastAPI) -> None:
    """Make every error of `app` a problem+json answer, never a traceback."""
    app.add_exception_handler(RequestValidationError, _invalid_request)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(Exception, _unexpected)
    app.add_exception_handler(InvalidField, _invalid_field)
    _install(app, InvalidStepCount, lambda r, e: _one_field(r, "/method/steps", e))
    _install(app, UnfitModel, lambda r, e: _one_field(r, "/system", e))
    _install(
        app,
        UnknownModel,
        lambda r, e: problem_response(r, 404, str(e), slug="unknown-model", title="Unknown model"),
    )
    _install(app, Refused, _refused)
    _install(app, NotReady, _unavailable)
    _install(app, ShuttingDown, _unavailable)
    _install(app, DeadlineExceeded, _deadline_exceeded)
    _install(app, ClientGone, _client_gone)
    _install(
        app,
        PlanningError,
        lambda r, e: problem_response(
            r, 500, str(e), slug="planning-failed", title="Planning failed"
        ),
    )


def _install(
    app: FastAPI, kind: type[Exception], answer: Callable[[Request, Exception], Response]
) -> None:
    async def handle(request: Request, error: Exception) -> Response:
        return answer(request, error)

    app.add_exception_handler(kind, handle)


def _one_field(request: Request, pointer: str, error: Exception) -> Response:
    return field_problem(request, [FieldError(pointer=pointer, detail=str(error))])


def _refused(request: Request, error: Exception) -> Response:
    assert isinstance(error, Refused)
    request.state.log_fields["rejected"] = error.reason
    headers = {"Retry-After": str(error.retry_after_s)}
    return problem_response(request, 429, str(error), slug="busy", headers=headers)


def _unavailable(request: Request, error: Exception) -> Response:
    if request.method == "POST":  # a plan, and not a probe
        request.state.log_fields["rejected"] = "not_ready"
    headers = {"Retry-After": RETRY_AFTER_SECONDS}
    return problem_response(request, 503, str(error), slug="not-ready", headers=headers)


def _deadline_exceeded(request: Request, error: Exception) -> Response:
    request.state.log_fields["rejected"] = "deadline_exceeded"
    return problem_response(request, 504, str(error), slug="deadline-exceeded")


def _client_gone(request: Request, error: Exception) -> Response:
    """Answer to nobody; the status, which others use for it too, is for log and metrics."""
    request.state.log_fields["rejected"] = "client_gone"
    return problem_response(request, 499, str(error), title="Client gone")


async def _invalid_field(request: Request, error: Exception) -> Response:
    assert isinstance(error, InvalidField)
    return _one_field(request, error.pointer, error)


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    return problem_response(request, error.status_code, str(error.detail), headers=headers)


async def _unexpected(request: Request, _: Exception) -> Response:
    # Answered outside of the middleware that puts the id into every other answer, and followed by
    # the connection's end, because uvicorn sees the error, too.
    headers = {"X-Request-ID": correlation_id.get() or "", "Connection": "close"}
    detail = "an unexpected error; the server's log tells more"  # uvicorn logs it
    return problem_response(request, 500, detail, headers=headers)


async def _invalid_request(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    errors = error.errors()
    if errors[0]["type"] == "json_invalid":
        detail = f"the body is not JSON: {errors[0]['ctx']['error']} at byte {errors[0]['loc'][1]}"
        return problem_response(request, 400, detail, slug="not-json", title="Not JSON")
    if isinstance(error.body, bytes):
        detail = "the body must be JSON, sent with Content-Type: application/json"
        return problem_response(request, 422, detail, slug="invalid-request")
    return field_problem(
        request,
        [
            FieldError(
                pointer=_pointer(item["loc"][1:], error.body, item["type"] == "missing"),
                detail=_detail(item),
            )
            for item in errors
        ],
    )


def _pointer(location: tuple[int | str, ...], body: Any, is_missing: bool) -> str:
    """Return the JSON pointer (RFC 6901) of a validation error's location within `body`.

    Pydantic puts the tag of a union's member among the keys; a tag is a key that the body lacks,
    as it lacks a missing field, which stands last.
    """
    pointer, value = "", body
    for index, key in enumerate(location):
        is_field = is_missing and index == len(location) - 1
        if isinstance(value, dict):
            if key not in value and not is_field:
                continue
            value = value.get(key)
        elif isinstance(value, list) and isinstance(key, int) and key < len(value):
            value = value[key]
        elif not isinstance(value, list):
            continue
        pointer += "/" + str(key).replace("~", "~0").replace("/", "~1")
    return pointer


def _detail(item: dict[str, Any]) -> str:
    """Return what is wrong with one field; a number that is not finite is called by its name."""
    value = item.get("input")
    if isinstance(value, float) and not math.isfinite(value):
        name = "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
        return f"{name} is not a finite number"
    match item["type"]:
        case "union_tag_invalid":
            context = item["ctx"]
            return f"no method {context['tag']!r}; there are: {context['expected_tags']}"
        case "union_tag_not_found":
            return "the method's name is missing"
        case "model_attributes_type":
            return "must be an object"
    return str(item["msg"]).removeprefix("Value error, ")
