"""The pages for readers, and OpenAPI for what FastAPI does not see.

That is the problem's schema, and what the middleware answers.
"""

from collections.abc import Collection
from typing import Any

from fastapi import FastAPI, Request
from fastapi.openapi.docs import get_swagger_ui_html
from fastapi.responses import HTMLResponse

from app.api.errors import MEDIA_TYPE
from app.api.keys import is_public
from app.wire.batches import BatchFailure, BatchPlan
from app.wire.problems import ProblemDetails

SCHEMAS = "#/components/schemas/"
SECURITY_SCHEME = "API key"


def add_pages(app: FastAPI) -> None:
    """Add `/docs`.

    Its addresses lie below the root path; where there is none they are relative, and hold behind a
    proxy that offers the service under a path of its own.
    """

    async def page(request: Request) -> HTMLResponse:
        root_path = request.scope["root_path"]
        base = f"{root_path}/" if root_path else ""
        assets = f"{base}static-offline-docs"
        return get_swagger_ui_html(
            openapi_url=f"{base}openapi.json",
            title=app.title,
            swagger_js_url=f"{assets}/swagger-ui-bundle.js",
            swagger_css_url=f"{assets}/swagger-ui.css",
            swagger_favicon_url=f"{assets}/favicon.png",
        )

    app.add_api_route("/docs", page, include_in_schema=False)


def document_middleware(app: FastAPI, private_except: Collection[str] | None) -> None:
    """Let `app.openapi()` tell of problems, slow bodies and keys.

    Args:
        app: its schema is extended.
        private_except: the paths that need no API key; None where no path needs one.
    """
    build = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            _extend(build(), private_except)
        return build()

    app.openapi = openapi  # type: ignore[method-assign]  # as FastAPI's documentation does


def _extend(document: dict[str, Any], private_except: Collection[str] | None) -> None:
    for told in (ProblemDetails, BatchPlan, BatchFailure):
        schema = told.model_json_schema(ref_template=SCHEMAS + "{model}", mode="serialization")
        known = schema.pop("$defs", {}) | {told.__name__: schema}
        document["components"]["schemas"] = known | document["components"]["schemas"]
    if private_except is not None:
        document["components"]["securitySchemes"] = {
            SECURITY_SCHEME: {"type": "http", "scheme": "bearer"}
        }
    for path, operations in document["paths"].items():
        for operation in operations.values():
            answers = operation["responses"]
            if "requestBody" in operation:
                answers["408"] = _problem("The body did not arrive in time.")
            if private_except is not None and not is_public(path, private_except):
                operation["security"] = [{SECURITY_SCHEME: []}]
                answers["401"] = _problem("No valid API key was sent.")


def _problem(description: str) -> dict[str, Any]:
    schema = {"$ref": SCHEMAS + ProblemDetails.__name__}
    return {"description": description, "content": {MEDIA_TYPE: {"schema": schema}}}
