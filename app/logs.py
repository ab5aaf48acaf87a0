"""How the server process logs: JSON lines on stderr, each with the id of its request."""

import logging
import logging.config

from pythonjsonlogger.core import RESERVED_ATTRS


def log_as_json(level: str) -> None:
    """Make every logger of this process write JSON lines to stderr from `level` on.

    Uvicorn's own lines and Python's warnings are among them; times are UTC.
    """
    logging.captureWarnings(True)
    logging.config.dictConfig(
        {
            "version": 1,
            "disable_existing_loggers": False,
            "filters": {"request_id": {"()": "asgi_correlation_id.CorrelationIdFilter"}},
            "formatters": {
                "json": {
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
            },
            "handlers": {
                "stderr": {
                    "class": "logging.StreamHandler",
                    "formatter": "json",
                    "filters": ["request_id"],
                }
            },
            "root": {"handlers": ["stderr"], "level": level.upper()},
            "loggers": {
                # It tells of every step of a compilation.
                "numba": {"level": "WARNING"},
                # It warns of each request that comes with an id of another form.
                "asgi_correlation_id": {"level": "ERROR"},
            },
        }
    )
