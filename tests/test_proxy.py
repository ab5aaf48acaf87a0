"""Behind nginx: with a path that it strips or hands on, and TLS that ends there."""

import logging
import re
import shutil
import ssl
import subprocess
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urljoin

import httpx
import pytest
import trustme
from fastapi import Request
from websockets.sync.client import connect
from websockets.typing import Origin

from app.launch import START_SECONDS, free_port
from app.main import create_app
from app.settings import Settings
from tests.served import running, wait_until

NGINX = shutil.which("nginx")
pytestmark = pytest.mark.skipif(NGINX is None, reason="nginx is not installed")

CONFIGURATION = """
daemon off;
master_process off;
pid nginx.pid;
events {{}}
http {{
    access_log off;
    client_body_temp_path body;
    proxy_temp_path proxy;
    fastcgi_temp_path fastcgi;
    uwsgi_temp_path uwsgi;
    scgi_temp_path scgi;
    ssl_certificate certificate.pem;
    ssl_certificate_key key.pem;
    proxy_set_header Host $http_host;
    proxy_set_header X-Forwarded-For $proxy_add_x_forwarded_for;
    proxy_set_header X-Forwarded-Proto $scheme;
    server {{
        listen 127.0.0.1:{stripping[http]};
        listen 127.0.0.1:{stripping[https]} ssl;
        location /planner/ {{ proxy_pass {rooted}/; }}
        location = /planner/control {{
            proxy_pass {rooted}/control;
            proxy_http_version 1.1;
            proxy_set_header Upgrade $http_upgrade;
            proxy_set_header Connection upgrade;
            proxy_set_header Host $http_host;
            proxy_set_header X-Forwarded-For $proxy_add_x_forwarded_for;
            proxy_set_header X-Forwarded-Proto $scheme;
        }}
        location /elsewhere/ {{ proxy_pass {rootless}/; }}
    }}
    server {{
        listen 127.0.0.1:{keeping[http]};
        listen 127.0.0.1:{keeping[https]} ssl;
        location /planner {{ proxy_pass {rooted}; }}
    }}
}}
"""
UNIFORM = {
    "initial_state": [0.0, 0.0],
    "target_state": [0.2, 0.0],
    "method": "uniform",
    "num_candidates": 1,
    "seed": 1,
}


SCHEMES = ("http", "https")
WAYS = ("stripping", "keeping", "unknown")
"""What the proxy does with the path below which it offers the service; one service knows none."""


class Proxy(NamedTuple):
    """A running proxy."""

    client: httpx.Client
    """It trusts the proxy's certificate."""
    ports: dict[str, dict[str, int]]
    """By what is done with the path, and by scheme."""

    def url(self, way: str, scheme: str) -> str:
        """Return where the service is offered."""
        if way == "unknown":
            return f"{scheme}://127.0.0.1:{self.ports['stripping'][scheme]}/elsewhere/"
        return f"{scheme}://127.0.0.1:{self.ports[way][scheme]}/planner/"


@contextmanager
def service(root_path: str, store: Path) -> Iterator[str]:
    """Serve; `/seen` tells the scheme and the client that the service sees."""
    settings = Settings(model_store=store, root_path=root_path)
    app = create_app(settings)

    async def seen(request: Request) -> list[str]:
        assert request.client is not None
        return [request.url.scheme, request.client.host]

    app.add_api_route("/seen", seen, include_in_schema=False)
    with running(app, settings=settings) as url:
        wait_until(lambda: httpx.get(f"{url}/readyz").is_success)
        yield url


@pytest.fixture(scope="module")
def proxy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Proxy]:
    """A proxy before two services without models, one of which knows its root path."""
    assert NGINX is not None
    folder, store = tmp_path_factory.mktemp("nginx"), tmp_path_factory.mktemp("empty")
    authority = trustme.CA()
    certificate = authority.issue_cert("127.0.0.1")
    certificate.private_key_pem.write_to_path(folder / "key.pem")
    (folder / "certificate.pem").write_bytes(
        b"".join(part.bytes() for part in certificate.cert_chain_pems)
    )
    trusting = ssl.create_default_context()
    authority.configure_trust(trusting)
    ports = {way: {scheme: free_port() for scheme in SCHEMES} for way in ("stripping", "keeping")}
    with service("/planner", store) as rooted, service("", store) as rootless:
        (folder / "nginx.conf").write_text(
            CONFIGURATION.format(rooted=rooted, rootless=rootless, **ports)
        )
        command = [NGINX, "-p", str(folder), "-c", "nginx.conf", "-e", "stderr"]
        with (
            subprocess.Popen(command) as nginx,
            httpx.Client(verify=trusting, timeout=START_SECONDS) as client,
        ):
            try:
                proxy = Proxy(client, ports)
                wait_until(lambda: answers(proxy))
                yield proxy
            finally:
                nginx.terminate()


def answers(proxy: Proxy) -> bool:
    try:
        return proxy.client.get(proxy.url("keeping", "https") + "livez").is_success
    except httpx.ConnectError:
        return False


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("way", WAYS)
def test_the_documentation_finds_its_parts_and_its_document(
    proxy: Proxy, way: str, scheme: str
) -> None:
    url = proxy.url(way, scheme) + "docs"
    answer = proxy.client.get(url)
    assert answer.status_code == 200
    addresses = re.findall(r"(?:href=|src=|url: )[\"']([^\"']+)[\"']", answer.text)
    assert len(addresses) == 4
    parts = {address: proxy.client.get(urljoin(url, address)) for address in addresses}
    assert {part.status_code for part in parts.values()} == {200}
    (document,) = [part.json() for address, part in parts.items() if "openapi.json" in address]
    assert "/plan" in document["paths"]
    expected = {"servers": [{"url": "/planner"}]} if way != "unknown" else {}
    assert {key: document[key] for key in document if key == "servers"} == expected


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("way", WAYS)
def test_the_playground_finds_its_parts_and_the_service(
    proxy: Proxy, way: str, scheme: str
) -> None:
    url = proxy.url(way, scheme)
    page = proxy.client.get(url).text
    parts = set(re.findall(r'(?:href|src)="([^"]+)"', page))
    assert any(part.endswith("/main.js") for part in parts)
    assert {proxy.client.get(urljoin(url, part)).status_code for part in parts} == {200}
    (base,) = re.findall(r'data-base="([^"]*)"', page)
    assert proxy.client.get(urljoin(urljoin(url, base), "methods")).status_code == 200


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("way", WAYS)
def test_plans_and_problems_come_through(proxy: Proxy, way: str, scheme: str) -> None:
    url = proxy.url(way, scheme)
    assert proxy.client.post(f"{url}plan", json=UNIFORM).json()["seed"] == 1
    problem = proxy.client.post(f"{url}plan", json=UNIFORM | {"seed": -1}).json()
    assert problem["errors"][0]["pointer"] == "/seed"
    assert problem["instance"] == ("/plan" if way == "unknown" else "/planner/plan")


def test_sessions_and_single_steps_come_through(proxy: Proxy) -> None:
    url = proxy.url("stripping", "http")
    step = {"state": [0.0, 0.0], "target_state": [0.2, 0.0]}
    assert proxy.client.post(f"{url}control", json=step).json()["control"] > 0
    origin = url.removesuffix("/planner/")
    with connect(url.replace("http", "ws") + "control", origin=Origin(origin)) as session:
        session.send('{"type": "start", "target_state": [0.2, 0.0]}')
        assert '"started"' in str(session.recv())
        session.send('{"type": "measure", "position": 0.0, "velocity": 0.0}')
        assert '"control"' in str(session.recv())


def test_the_path_itself_is_the_playground_without_its_slash_too(proxy: Proxy) -> None:
    url = proxy.url("keeping", "https")
    assert proxy.client.get(url.removesuffix("/")).text == proxy.client.get(url).text


@pytest.mark.parametrize("scheme", SCHEMES)
def test_scheme_and_client_are_those_that_the_proxy_saw(
    proxy: Proxy, caplog: pytest.LogCaptureFixture, scheme: str
) -> None:
    caplog.set_level(logging.INFO, "breakaway.access")
    for way in WAYS:
        url = proxy.url(way, scheme) + "seen"
        assert proxy.client.get(url).json() == [scheme, "127.0.0.1"]
        further = proxy.client.get(url, headers={"X-Forwarded-For": "203.0.113.9"})
        assert further.json() == [scheme, "203.0.113.9"]

    def clients() -> Counter[str]:
        """Count who asked; lines of the tests before may still come in."""
        lines = [line.__dict__ for line in caplog.records]
        return Counter(line["client"] for line in lines if line["path"].endswith("seen"))

    wait_until(lambda: clients().total() == 2 * len(WAYS))
    assert clients() == {"127.0.0.1": len(WAYS), "203.0.113.9": len(WAYS)}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("path", ["plan/", "docs/", "livez/", "static-offline-docs/", "nope"])
def test_no_path_leads_elsewhere(proxy: Proxy, way: str, path: str) -> None:
    answer = proxy.client.post(
        proxy.url(way, "https") + path, json=UNIFORM, headers={"Authorization": "Bearer secret"}
    )
    assert answer.status_code in (404, 405)
    assert answer.headers["content-type"] == "application/problem+json"
    assert "location" not in answer.headers
