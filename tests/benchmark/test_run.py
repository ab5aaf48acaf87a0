"""Every benchmark runs, cut down, and the page that they make is Markdown."""

from itertools import pairwise
from types import ModuleType

import pytest
from markdown_it import MarkdownIt

from app.benchmark import (
    batches,
    capacity,
    concurrency,
    control,
    network,
    planning,
    quick_plans,
    requests,
    run,
    sampling,
    service,
)
from app.settings import SHIPPED_MODELS

SIZES: dict[ModuleType, dict[str, object]] = {
    network: {"ROWS": (1, 8), "PRODUCT_SIZE": 64, "TILE_PRODUCTS": 1},
    sampling: {"BUDGETS": (1,), "CANDIDATES": 1},
    planning: {"PAIRS": 1, "TASKS": 20, "RUNS": 1},
    quick_plans: {"SEQUENCES": 1},
    service: {"PAIRS": 1, "CALLS": 1},
    requests: {"ROUNDS": 1, "CALLS": 1, "REQUESTS_EACH": 1, "CONNECTIONS": 2},
    capacity: {"ROUNDS": 1, "REQUESTS": 2, "CONNECTIONS": 2},
    batches: {"SINGLE": 2, "MANY": 4, "PAIRS": 1, "CLIENTS": 2},
    concurrency: {"SMALL_REQUESTS": 1, "CLIENTS": 2, "REQUESTS_EACH": 1},
    control: {"STEPS": 10, "SESSIONS": 2, "SECONDS": 0.1},
}


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, sizes in SIZES.items():
        for name, value in sizes.items():
            monkeypatch.setattr(module, name, value)


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_the_page_has_a_section_for_each_benchmark_with_lists_and_tables() -> None:
    page = "\n".join(run.run(SHIPPED_MODELS, num_threads=2))

    tokens = MarkdownIt().enable("table").parse(page)
    headings = [after.content for token, after in pairwise(tokens) if token.type == "heading_open"]
    assert headings == [
        "Benchmark",
        "The network",
        "Sampling, beside the paper's sampler in eager PyTorch",
        "Planning",
        "The service",
        "Plans a core",
        "Many requests at once",
        "Many problems in one request",
        "Closed loop",
    ]
    kinds = [token.type for token in tokens]
    assert kinds.count("table_open") == 3
    assert kinds.count("bullet_list_open") == 6
    # Nothing stands in a paragraph of its own but the line that says what was measured.
    assert len([t for t in tokens if t.type == "paragraph_open" and t.level == 0]) == 1
