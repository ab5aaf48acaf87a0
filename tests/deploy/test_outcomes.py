"""Errors that travel from a replica to the routes."""

import pickle

import pytest

from app.deploy.outcomes import Outcome, Raised
from app.deploy.routing import Load
from app.inference.model_store import UnknownModel
from app.serving.refusals import DeadlineExceeded, InvalidField, Refused


@pytest.mark.parametrize(
    "error",
    [
        InvalidField("/carry/plan", "it is too short"),
        Refused("deadline", "there is no time", 2.5),
        DeadlineExceeded("the deadline has passed"),
        UnknownModel("no model 'x'"),
    ],
)
def test_an_error_arrives_as_it_was_raised(error: Exception) -> None:
    sent: Outcome[int] = Outcome("a", Load(), Raised.of(error))
    came: Outcome[int] = pickle.loads(pickle.dumps(sent))
    with pytest.raises(type(error)) as raised:
        came.unwrap()
    assert str(raised.value) == str(error)
    assert vars(raised.value) == vars(error)
