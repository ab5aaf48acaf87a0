"""A short day of a small cluster, by the routing and admission of the real one."""

from tests.load.cluster_day import ClusterDay


def test_every_work_of_the_day_is_answered_or_refused() -> None:
    day = ClusterDay(replicas=20, ingresses=3, seconds=10.0, deaths_per_second=0.3, seed=1)
    day.run()
    outcomes = day.outcomes
    assert outcomes["deaths"] > 1
    assert outcomes["again"] > 0
    assert outcomes["asked"] > 1000
    ended = ("answered", "late", "refused")
    assert sum(outcomes[end] for end in ended) == outcomes["asked"]
    assert outcomes["late"] + outcomes["refused"] < 0.05 * outcomes["asked"]
