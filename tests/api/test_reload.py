"""Reloading the model store over HTTP."""

import shutil
from pathlib import Path

import httpx

from app.settings import Settings
from tests.served import serving, wait_until_ready
from tests.stores import publish_version


def test_it_is_there_only_where_the_settings_say_so(client: httpx.Client) -> None:
    assert client.post("/admin/reload").status_code == 404
    assert "/admin/reload" not in client.get("/openapi.json").json()["paths"]


def test_it_takes_new_models_and_keeps_the_old_ones_if_one_is_bad(
    model_store: Path, tmp_path: Path
) -> None:
    store = Path(shutil.copytree(model_store, tmp_path / "store"))
    with serving(Settings(model_store=store, admin=True)) as client:
        wait_until_ready(client)
        publish_version(store, 2)
        answer = client.post("/admin/reload")
        assert answer.status_code == 200
        assert [model["version"] for model in answer.json()] == ["2", "1"]
        assert client.get("/models").json() == answer.json()

        publish_version(store, 3, sha256="0" * 64)
        refused = client.post("/admin/reload")
        assert refused.status_code == 409
        assert refused.headers["Content-Type"] == "application/problem+json"
        assert "changed or damaged" in refused.json()["detail"]
        assert client.get("/models").json() == answer.json()
        assert client.get("/readyz").is_success
