"""How candidates came out of noise: to be looked at, nothing is planned with it."""

from dataclasses import dataclass

from app.planning.arrays import FloatArray
from app.planning.metrics import terminal_error
from app.planning.plant.rollout import rollout
from app.planning.problem import Problem


@dataclass(frozen=True, slots=True)
class Denoising:
    """K candidates before the S steps of a sampler, and after each."""

    controls: FloatArray
    """(S+1, K, H), units of control; noise exceeds the limits."""
    states: FloatArray
    """(S+1, K, H+1, 2): what they would do, held to the limits."""
    terminal_errors: FloatArray
    """(S+1, K): how far from the target that ends, m."""

    @classmethod
    def of(cls, problem: Problem, controls: FloatArray) -> "Denoising":
        """Roll `controls` (S+1, K, H) out."""
        plant = problem.system.plant
        num_stages, num_candidates, horizon = controls.shape
        clipped = controls.clip(plant.lowest_control, plant.highest_control)
        states = rollout(problem.system, problem.initial_state, clipped.reshape(-1, horizon))
        states = states.reshape(num_stages, num_candidates, horizon + 1, 2)
        return cls(controls, states, terminal_error(states[:, :, -1], problem.target_state))
