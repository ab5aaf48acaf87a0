"""A copy of the package, to be tampered with."""

import shutil
from pathlib import Path

import pytest

import app
from tests.compilation.source import PROBE


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Copy the package to where its caches and sources can be tampered with."""
    copy = tmp_path / "source"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(app.__file__).parent, copy / "app", ignore=ignored)
    (copy / "app" / "planning" / "probe.py").write_text(PROBE)
    return copy
