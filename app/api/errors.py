"""Errors as RFC 9457 problem+json: what can go wrong, and how each is told to the client."""

from collections.abc import Callable
from http import HTTPStatus

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
from app.wire.field_errors import field_errors
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
    within_body = [item | {"loc": item["loc"][1:]} for item in errors]
    return field_problem(request, field_errors(within_body, error.body))
