"""A store whose model was changed after it was published."""

import shutil
from pathlib import Path

import pytest


@pytest.fixture
def tampered_store(model_store: Path, tmp_path: Path) -> Path:
    store = tmp_path / "tampered"
    shutil.copytree(model_store, store)
    checkpoint = store / "tiny" / "1" / "unet.pt"
    checkpoint.write_bytes(b"x" + checkpoint.read_bytes()[1:])
    return store
