"""The files of the playground, as they are sent: small, cached, and under a strict policy."""

import re

import httpx
import pytest

MOST_BYTES = 400_000


def assets(client: httpx.Client) -> list[str]:
    page = client.get("/").text
    return sorted(set(re.findall(r'(?:href|src)="(playground/[^"]+)"', page)))


def test_the_first_view_is_small_and_from_here_alone(client: httpx.Client) -> None:
    found = assets(client)
    assert any(address.endswith("/main.js") for address in found)
    sent = 0
    for address in ("", *found):
        with client.stream("GET", f"/{address}", headers={"Accept-Encoding": "gzip"}) as answer:
            assert answer.headers["content-encoding"] == "gzip"
            sent += len(b"".join(answer.iter_raw()))
            policy = answer.headers["content-security-policy"]
            assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
            assert "unsafe" not in policy
            assert "http" not in policy
    assert sent < MOST_BYTES


def test_every_module_is_there_that_another_one_imports(client: httpx.Client) -> None:
    addresses = {f"http://page/{address}" for address in assets(client)}
    for address in sorted(addresses):
        if address.endswith(".js") and "/vendor/" not in address:
            text = client.get(httpx.URL(address).path).text
            for name in re.findall(r'^import .*"(\.[^"]+)";$', text, re.MULTILINE):
                assert str(httpx.URL(address).join(name)) in addresses


def test_files_are_kept_for_ever_and_the_page_is_asked_for_again(client: httpx.Client) -> None:
    page = client.get("/")
    assert page.headers["cache-control"] == "no-cache"
    tag = {"If-None-Match": page.headers["etag"]}
    assert client.get("/", headers=tag).status_code == 304
    file = client.get(f"/{assets(client)[0]}")
    assert "immutable" in file.headers["cache-control"]
    assert client.get("/", headers={"Accept-Encoding": "identity"}).text == page.text


@pytest.mark.parametrize(
    "path", ["x/main.js", "{}/nothing.js", "{}/../__init__.py", "{}/index.html"]
)
def test_nothing_else_is_sent(client: httpx.Client, path: str) -> None:
    version = assets(client)[0].split("/")[1]
    assert client.get(f"/playground/{path.format(version)}").status_code == 404
