"""The image's description of itself; `python -m tests.container` builds and runs it."""

from tests.deploy.version import ROOT, VERSION


def test_the_image_is_labelled_with_the_version_of_the_package() -> None:
    text = (ROOT / "Dockerfile").read_text()
    assert f'org.opencontainers.image.version="{VERSION}"' in text
