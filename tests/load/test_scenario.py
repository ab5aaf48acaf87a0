import json

from hypothesis import given
from hypothesis import strategies as st

from app.wire.requests import MultistepPlanRequest, PlanRequest
from tests.load.scenario import question

numbers = st.integers(0, 10**6)


@given(seed=numbers, index=numbers)
def test_every_request_of_the_mix_is_valid(seed: int, index: int) -> None:
    asked = question(seed, index)
    schema = PlanRequest if asked.route == "/plan" else MultistepPlanRequest
    schema.model_validate_json(json.dumps(asked.body | {"deadline_ms": asked.deadline_ms}))
    assert 300 <= asked.deadline_ms <= 5000
    assert asked.rows >= 0
    assert asked.seconds > 0


@given(seed=numbers, index=numbers)
def test_a_request_follows_from_seed_and_number_alone(seed: int, index: int) -> None:
    assert question(seed, index) == question(seed, index)
    assert question(seed, index).body != question(seed, index + 1).body


def test_the_mix_has_everything_in_it() -> None:
    asked = [question(0, index) for index in range(2000)]
    bodies = [each.body for each in asked]
    names = {
        str(body["method"]) if isinstance(body["method"], str) else body["method"]["name"]
        for body in bodies
    }
    assert names == {"action_diffusion", "dataset_prior", "uniform", "cem", "icem", "mppi"}
    assert {each.route for each in asked} == {"/plan", "/plan_multistep"}
    assert {body["num_candidates"] for body in bodies} >= {1, 16, 512}
    for field in ("refine", "initial", "system", "horizon", "objective"):
        assert any(field in body for body in bodies), field
    for sampler in ("ddim", "paper"):
        assert any(f"'{sampler}'" in str(body) for body in bodies)
    assert 0.02 < sum(each.seconds for each in asked) / len(asked) < 0.1
