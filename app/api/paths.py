"""A request's path, as the routes have it."""

from starlette.types import Scope


def route_path(scope: Scope) -> str:
    """Return a request's path as the routes have it, without the root path."""
    path: str = scope["path"]
    return path.removeprefix(mount_path(scope))


def mount_path(scope: Scope) -> str:
    """Return the root path of the whole service, within a mounted application, too."""
    path: str = scope.get("app_root_path", scope.get("root_path", ""))
    return path
