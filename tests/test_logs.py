"""The server process's log: lines of JSON or for people, whoever writes them."""

import json
import re
import subprocess
import sys
from datetime import datetime, timedelta
from typing import Any

import pytest

SCRIPT = """
import logging, sys, warnings
from asgi_correlation_id import correlation_id
from app.logs import set_up_logging

set_up_logging("info", sys.argv[1])
logging.getLogger("app.somewhere").info("ready after %.1f s", 1.25, extra={"models": 2})
logging.getLogger("app.somewhere").debug("not worth it")
logging.getLogger("uvicorn.error").warning("up", extra={"color_message": "up, in colours"})
correlation_id.set("asked-1")
try:
    1 / 0
except ZeroDivisionError:
    logging.getLogger("uvicorn.error").exception("failed\\nbadly")
warnings.warn("old")
"""


def logged(form: str) -> list[str]:
    command = [sys.executable, "-W", "always", "-c", SCRIPT, form]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert not done.stdout
    return done.stderr.splitlines()


@pytest.mark.parametrize("form", ["auto", "json"])
def test_every_line_is_an_object_with_time_level_logger_and_message(form: str) -> None:
    lines: list[dict[str, Any]] = [json.loads(line) for line in logged(form)]
    ready, up, failed, old = lines
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


def test_people_read_lines() -> None:
    lines = logged("text")
    assert re.fullmatch(r"\d\d:\d\d:\d\d INFO     ready after 1.2 s *", lines[0])
    assert any("ZeroDivisionError: division by zero" in line for line in lines)
    assert not any(line.startswith("{") for line in lines)
