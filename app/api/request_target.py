"""What a request is for: its path, below the path under which the service is offered."""

import re

from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.middleware import HttpMiddleware

ABSOLUTE_FORM = re.compile(r"https?://[^/]*(?P<path>.*)", re.IGNORECASE | re.DOTALL)
"""How a proxy is asked, and every server must understand it (RFC 9112, 3.2.2)."""


class RequestTarget(HttpMiddleware):
    """Put every request's path below the root path, however it was written.

    One proxy strips the path under which it offers the service, another one hands it on, and probes
    come past either.

    Args:
        app: what comes next.
        root_path: "" or a path without a slash at its end.
    """

    def __init__(self, app: ASGIApp, root_path: str) -> None:
        super().__init__(app)
        self.root_path = root_path

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        path = scope["path"]
        if absolute := ABSOLUTE_FORM.fullmatch(path):
            path = absolute["path"] or "/"
        if path == self.root_path:
            path += "/"
        elif path.startswith("/") and not path.startswith(f"{self.root_path}/"):
            path = self.root_path + path
        # In place: what stands outside of here answers for errors that nobody foresaw.
        scope.update(path=path, root_path=self.root_path)
        await self.app(scope, receive, send)

    async def handle_session(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self.handle(scope, receive, send)
