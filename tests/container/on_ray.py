"""The manifest's application on a Ray of its own, inside the image."""

import json
from contextlib import AbstractContextManager

import yaml

from app.launch import free_port
from tests.container.chroot import Image, Served, ready
from tests.deploy.version import ROOT

MANIFEST = ROOT / "app/deploy/kubernetes/rayservice.yaml"
RUN = 'echo "$0" > /tmp/serve.yaml && exec serve run /tmp/serve.yaml'


def serving_on_ray(image: Image, user: str) -> AbstractContextManager[Served]:
    """Run what the manifest says, small and on a free port, until the context ends.

    Raises:
        TimeoutError: it does not become ready.
    """
    port = free_port()
    manifest = yaml.safe_load(MANIFEST.read_text())
    config = yaml.safe_load(manifest["spec"]["serveConfigV2"])
    config["http_options"] = {"host": "127.0.0.1", "port": port}
    config["applications"][0]["args"] = {"max_replicas": 1}
    return ready(image.command("sh", "-c", RUN, json.dumps(config), user=user), port)
