"""The playground: a page that is a client of the same API as any other, nothing private.

What it does is in `page/`, as a browser reads it; here is how its files are sent.
"""

import gzip
import re
from dataclasses import dataclass
from hashlib import sha256
from mimetypes import guess_type
from pathlib import Path

from fastapi import FastAPI, HTTPException, Request
from fastapi.responses import Response

from app.api.sending import accepts_gzip

PAGE = Path(__file__).parent / "page"
INDEX = "index.html"
SECURITY = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
FOR_EVER = "public, max-age=31536000, immutable"
"""Under an address that changes with the content."""
ASK_AGAIN = "no-cache"


@dataclass(frozen=True, slots=True)
class File:
    """A file of the page, ready to be sent."""

    content: bytes
    compressed: bytes
    media_type: str

    @classmethod
    def of(cls, name: str, content: bytes) -> "File":
        """Compress a file, once."""
        return cls(content, gzip.compress(content, mtime=0), guess_type(name)[0] or "text/plain")

    def sent(self, request: Request, caching: str) -> Response:
        """Return the file, compressed where the client takes it; 304 where the client has it."""
        tag = f'"{sha256(self.content).hexdigest()[:16]}"'
        headers = SECURITY | {"Cache-Control": caching, "ETag": tag, "Vary": "Accept-Encoding"}
        if request.headers.get("If-None-Match") == tag:
            return Response(status_code=304, headers=headers)
        if accepts_gzip(",".join(request.headers.getlist("Accept-Encoding"))):
            headers["Content-Encoding"] = "gzip"
            return Response(self.compressed, headers=headers, media_type=self.media_type)
        return Response(self.content, headers=headers, media_type=self.media_type)


def add_playground(app: FastAPI) -> None:
    """Add the page at `/`, and its files below `/playground/`.

    Like those of the documentation, their addresses lie below the root path, or are relative.
    """
    texts = {
        path.relative_to(PAGE).as_posix(): path.read_bytes()
        for path in sorted(PAGE.rglob("*"))
        if path.is_file()
    }
    version = sha256(b"\0".join(texts.values())).hexdigest()[:16]
    files = {name: File.of(name, text) for name, text in texts.items() if name != INDEX}
    modules = [name for name in files if name.endswith((".js", ".mjs"))]

    async def page(request: Request) -> Response:
        root_path = request.scope["root_path"]
        base = f"{root_path}/" if root_path else ""
        text = _filled(texts[INDEX].decode(), base, f"{base}playground/{version}/", modules)
        return File.of(INDEX, text.encode()).sent(request, ASK_AGAIN)

    async def file(request: Request) -> Response:
        name = request.path_params["name"]
        if request.path_params["version"] != version or name not in files:
            raise HTTPException(404)
        return files[name].sent(request, FOR_EVER)

    app.add_route("/", page, include_in_schema=False)
    app.add_route("/playground/{version}/{name:path}", file, include_in_schema=False)


def _filled(index: str, base: str, assets: str, modules: list[str]) -> str:
    """Return the page with its addresses; a browser asks for all modules at once."""
    preloads = "\n".join(f'<link rel="modulepreload" href="{assets}{name}">' for name in modules)
    values = {"base": base, "assets": assets, "preloads": preloads}
    return re.sub(r"\{\{(\w+)\}\}", lambda match: values[match[1]], index)
