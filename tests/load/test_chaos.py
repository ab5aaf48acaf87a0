import asyncio
from pathlib import Path

import pytest
from rich.console import Console

from tests.load.chaos import chaos
from tests.load.verdict import Verdict


def treated_badly(folder: Path, seconds: float) -> Verdict:
    verdict = asyncio.run(chaos(seconds, 0, folder))
    verdict.print(Console(width=120))
    return verdict


def test_clients_hang_up_and_send_rubbish_while_models_change(tmp_path: Path) -> None:
    # Beside other tests or on a slow machine times say nothing.
    checks = treated_badly(tmp_path, 6).checks
    assert [check.name for check in checks if not check.passed and not check.is_timing] == []


@pytest.mark.slow
def test_clients_do_so_for_ten_minutes(tmp_path: Path) -> None:
    assert treated_badly(tmp_path, 600).failures == []
