"""The server process's log: JSON lines, whoever writes them."""

import json
import subprocess
import sys
from datetime import datetime, timedelta
from typing import Any

SCRIPT = """
import logging, warnings
from asgi_correlation_id import correlation_id
from app.logs import log_as_json

log_as_json("info")
logging.getLogger("app.somewhere").info("ready after %.1f s", 1.25, extra={"models": 2})
logging.getLogger("app.somewhere").debug("not worth it")
logging.getLogger("uvicorn.error").info("up", extra={"color_message": "up, in colours"})
correlation_id.set("asked-1")
try:
    1 / 0
except ZeroDivisionError:
    logging.getLogger("uvicorn.error").exception("failed\\nbadly")
warnings.warn("old")
"""


def logged() -> list[dict[str, Any]]:
    command = [sys.executable, "-W", "always", "-c", SCRIPT]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert not done.stdout
    return [json.loads(line) for line in done.stderr.splitlines()]


def test_every_line_is_an_object_with_time_level_logger_and_message() -> None:
    ready, up, failed, old = logged()
    for line in (ready, up, failed, old):
        assert list(line)[:4] == ["timestamp", "level", "logger", "message"]
        assert datetime.fromisoformat(line["timestamp"]).utcoffset() == timedelta(0)
    assert ready["level"] == "INFO"
    assert ready["logger"] == "app.somewhere"
    assert ready["message"] == "ready after 1.2 s"
    assert ready["models"] == 2
    assert ready["request_id"] is None
    assert "color_message" not in up
    assert failed["message"] == "failed\nbadly"
    assert failed["request_id"] == "asked-1"
    assert failed["traceback"].startswith("Traceback (most recent call last):")
    assert failed["traceback"].endswith("ZeroDivisionError: division by zero")
    assert old["logger"] == "py.warnings"
