"""Model stores that change while a service runs."""

import json
import shutil
from pathlib import Path
from typing import Any

from tests.conftest import MODEL


def publish_version(store: Path, version: int, **fields: Any) -> Path:
    """Put the tiny model into its store again, as another version, whole at once."""
    draft = Path(shutil.copytree(store / MODEL / "1", store.parent / "draft"))
    manifest = json.loads((draft / "manifest.json").read_text())
    (draft / "manifest.json").write_text(json.dumps(manifest | {"version": version} | fields))
    return draft.rename(store / MODEL / str(version))
