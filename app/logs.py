"""How the server process logs on stderr: lines for people, or JSON with the id of each request."""

import logging
import logging.config
from typing import Any

from pythonjsonlogger.core import RESERVED_ATTRS

from app.settings import LogFormat
from app.terminal import TERMINAL


def set_up_logging(level: str, form: LogFormat) -> None:
    """Make every logger of this process write to stderr, from `level` on.

    Uvicorn's own lines and Python's warnings are among them.

    Args:
        level: the least severe one.
        form: `text` is for people, with local times; `json` has a line of JSON for each record,
            with UTC; `auto` is text on a terminal, and JSON elsewhere.
    """
    is_text = form == "text" or (form == "auto" and TERMINAL.is_terminal)
    logging.captureWarnings(True)
    logging.config.dictConfig(
        {
            "version": 1,
            "disable_existing_loggers": False,
            "filters": {"request_id": {"()": "asgi_correlation_id.CorrelationIdFilter"}},
            "formatters": {"json": _JSON},
            "handlers": {"stderr": _TEXT_HANDLER if is_text else _JSON_HANDLER},
            "root": {"handlers": ["stderr"], "level": level.upper()},
            "loggers": {
                # It tells of every step of a compilation.
                "numba": {"level": "WARNING"},
                # It tells of steps in between, and that it is running before the service is.
                "uvicorn": {"level": "WARNING"},
                # It warns of each request that comes with an id of another form.
                "asgi_correlation_id": {"level": "ERROR"},
            },
        }
    )


_JSON: dict[str, Any] = {
    "()": "pythonjsonlogger.json.JsonFormatter",
    "fmt": ["timestamp", "levelname", "name", "message"],
    "timestamp": True,
    "rename_fields": {
        "levelname": "level",
        "name": "logger",
        "exc_info": "traceback",
        "correlation_id": "request_id",
    },
    # Uvicorn's second copy of its messages, for terminals.
    "reserved_attrs": [*RESERVED_ATTRS, "color_message"],
}
_JSON_HANDLER = {
    "class": "logging.StreamHandler",
    "formatter": "json",
    "filters": ["request_id"],
}
_TEXT_HANDLER = {
    "class": "rich.logging.RichHandler",
    "console": TERMINAL,
    "show_path": False,
    "log_time_format": "%H:%M:%S",
    "omit_repeated_times": False,
}
