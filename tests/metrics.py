"""Reading `GET /metrics`."""

import httpx
from prometheus_client.parser import text_string_to_metric_families


def value(text: str, name: str, **labels: str) -> float:
    """Return the sum of all samples of that name that have these labels."""
    return sum(
        sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if sample.name == name and labels.items() <= sample.labels.items()
    )


def pending(client: httpx.Client) -> float:
    """Return how many plans a service is at work on, or has waiting."""
    return value(client.get("/metrics").text, "breakaway_pending_requests")
