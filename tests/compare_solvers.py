"""The planners beside general-purpose solvers, on the same random rest-to-rest tasks.

    python -m tests.compare_solvers --tasks 40 --seed 0

CMA-ES (pycma) and an interior-point method on a smoothed plant (CasADi with IPOPT) are what one
would otherwise reach for. A plan counts by the rollout of its controls through the true dynamics,
and its gap is the terminal error less the least reachable one. Both solvers stop as soon as their
plan is within `TOLERANCE` of the target, which spares them time and leaves gaps just below it;
`refine` goes on until rounding ends it, and the Cross-Entropy Method spends its whole budget.

What was tried, on other tasks, to give each solver its best. The one kept arrives most often, and
of those the fastest:

- CMA-ES: full and diagonal covariance, populations of 16, 32 and 64, first standard deviations of
  a quarter to the whole of u_max, bounds by clipping, BoundTransform and BoundPenalty, pycma's
  criteria of stagnation and looser ones.
- IPOPT: friction at the velocity before and after the step, with and without the static peak, the
  terminal error as the objective and as a constraint, starts from zero, a ramp and a bang-bang
  rollout, one sharpness and continuations of 3 to 14, several barriers, with and without the
  multipliers of the stage before, monotone and adaptive.

The median time is given by the wall clock and by the processor's. Everything runs on one thread, so
where the machine has other things to do the second is the one to compare by: a plan of a tenth of a
second is interrupted then, one of a tenth of a millisecond is not.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter, process_time
from typing import Any, NamedTuple, TypeAlias

import casadi
import cma
import numpy as np

from app.planning.arrays import FloatArray
from app.planning.methods import CEM, DatasetPrior, Uniform
from app.planning.metrics import terminal_error
from app.planning.objectives import TOLERANCE
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON, Problem
from app.planning.reachable.reachability import reachability
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement, refine


class Answer(NamedTuple):
    """What a planner found, and what it took."""

    controls: FloatArray
    """(H,)."""
    rollouts: int
    iterations: int = 0
    """Of the interior-point method, each a derivative and a factorisation of the whole horizon."""


Planner: TypeAlias = Callable[[Problem, np.random.Generator], Answer]


@dataclass(frozen=True, slots=True)
class Row:
    """A planner over all tasks, a value each."""

    name: str
    gaps: list[float] = field(default_factory=list)
    milliseconds: list[float] = field(default_factory=list)
    processor_milliseconds: list[float] = field(default_factory=list)
    rollouts: list[int] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)

    def __str__(self) -> str:
        arrived = np.mean(np.array(self.gaps) <= TOLERANCE)
        work = f"{np.mean(self.rollouts):.0f}"
        if any(self.iterations):
            work += f" + {np.mean(self.iterations):.0f} IPOPT iterations"
        return (
            f"| {self.name} | {np.mean(self.gaps):.1e} | {np.median(self.gaps):.1e} "
            f"| {100 * arrived:.0f} % | {np.median(self.milliseconds):.3g} "
            f"| {np.median(self.processor_milliseconds):.3g} | {work} |"
        )


HEADER = (
    "| planner | mean gap to the floor | median gap | within 1e-6 of the floor | median ms a plan "
    "| median processor ms | mean rollouts |\n"
    "| --- | ---: | ---: | ---: | ---: | ---: | ---: |"
)


def tasks(number: int, seed: int) -> list[Problem]:
    """Draw targets to stop at, p uniform in [-1, 1] m, from rest at the origin."""
    positions = np.random.default_rng(seed).uniform(-1.0, 1.0, number)
    return [Problem(np.zeros(2), np.array([position, 0.0])) for position in positions]


def errors_of(problem: Problem, controls: FloatArray) -> FloatArray:
    """Return the terminal errors (K,) of `controls` (K, H) in the true dynamics."""
    states = rollout(problem.system, problem.initial_state, controls)
    return terminal_error(states[:, -1], problem.target_state)


def proposed(method: DatasetPrior | CEM, num_candidates: int) -> Planner:
    """Plan by `method` alone: `plan` without the measures and the floor that it reports."""

    def planner(problem: Problem, rng: np.random.Generator) -> Answer:
        controls = method.propose(problem, num_candidates, rng).controls
        best = controls[np.argmin(errors_of(problem, controls))]
        return Answer(best, Recipe(method, num_candidates).cost().rollouts)

    return planner


def refined(method: DatasetPrior | Uniform, num_candidates: int) -> Planner:
    """Plan by `method` and refinement."""

    def planner(problem: Problem, rng: np.random.Generator) -> Answer:
        candidates = method.propose(problem, num_candidates, rng)
        result = refine(problem, candidates.controls, Refinement())
        return Answer(result.controls[np.argmin(result.errors)], result.rollouts)

    return planner


def then_refined(first: Planner) -> Planner:
    """Refine the one plan of `first`."""

    def planner(problem: Problem, rng: np.random.Generator) -> Answer:
        answer = first(problem, rng)
        result = refine(problem, answer.controls[None], Refinement())
        return Answer(result.controls[0], answer.rollouts + result.rollouts, answer.iterations)

    return planner


@dataclass(frozen=True, slots=True)
class CMAES:
    """CMA-ES on the terminal error, restarted where pycma gives up before the budget is spent.

    Bounds are handled by clipping, which already arrives: on the one task tried, BoundTransform and
    BoundPenalty took two to four times as long for the same rollouts. Populations of 16 and 32 are
    about even.
    """

    population: int = 16
    initial_std: float = 0.5
    """As a fraction of u_max."""
    diagonal: bool = True
    """A diagonal covariance: takes as many rollouts as a full one, in half the time."""
    budget: int = 20_480

    def __call__(self, problem: Problem, rng: np.random.Generator) -> Answer:
        limit = problem.system.plant.highest_control
        best, best_error, rollouts = np.zeros(problem.horizon), np.inf, 0
        while best_error > TOLERANCE and rollouts < self.budget:
            options = {
                "popsize": self.population,
                "CMA_diagonal": self.diagonal,
                "ftarget": TOLERANCE,
                "seed": int(rng.integers(1, 2**31)),
                "verbose": -9,
            }
            strategy = cma.CMAEvolutionStrategy(
                np.zeros(problem.horizon), self.initial_std * limit, options
            )
            while rollouts < self.budget and not strategy.stop():
                sample = strategy.ask()
                controls = np.clip(sample, -limit, limit)
                errors = errors_of(problem, controls)
                rollouts += len(errors)
                strategy.tell(sample, errors.tolist())
                if errors.min() < best_error:
                    best, best_error = controls[np.argmin(errors)], float(errors.min())
        return Answer(best, rollouts)


SHARPNESSES = tuple(10 ** (-1.5 - k / 2) for k in range(9))
"""m/s, from 3e-2 to 3e-6."""


class SmoothedFriction:
    """IPOPT on a plant with tanh(v / sharpness) for the sign of v, sharper from stage to stage.

    Multiple shooting: controls, positions and velocities are all unknowns. Friction acts at the
    velocity after the step (before it, the plans chatter and end centimetres off), and peaks at
    the static friction near v = 0 (without, 6 of 10 arrive). Least energy subject to arrival is
    what IPOPT does best at: with the terminal error as the objective 6 to 8 of 10 arrive. From the
    second stage on it starts where the last one ended, multipliers included, at a small barrier.
    With a single sharpness a quarter arrive at most.

    Each stage is rolled out through the true dynamics; the best plan counts.
    """

    def __init__(self, problem: Problem, sharpnesses: tuple[float, ...] = SHARPNESSES) -> None:
        """Build the program once for the plant and horizon of `problem`."""
        self.sharpnesses = sharpnesses
        self.horizon = problem.horizon
        limit = problem.system.plant.highest_control
        program = _program(problem.system, problem.horizon)
        self.first = _solver(program, {})
        self.later = _solver(program, {"mu_init": 1e-3})
        free = np.full(2 * problem.horizon, np.inf)
        self.upper = np.concatenate([np.full(problem.horizon, limit), free])

    def __call__(self, problem: Problem, rng: np.random.Generator) -> Answer:  # noqa: ARG002
        start, target, limit = problem.initial_state, problem.target_state, self.upper[0]
        duration = self.horizon * problem.system.time_step
        ramp = np.linspace(start[0], target[0], self.horizon + 1)[1:]
        speed = np.full(self.horizon, (target[0] - start[0]) / duration)
        guess: dict[str, Any] = {"x0": np.concatenate([np.zeros(self.horizon), ramp, speed])}
        best, best_error = np.zeros(self.horizon), np.inf
        rollouts, iterations = 0, 0
        for sharpness in self.sharpnesses:
            solver = self.later if rollouts else self.first
            solution = solver(
                **guess,
                p=[*start, *target, sharpness],
                lbx=-self.upper,
                ubx=self.upper,
                lbg=0,
                ubg=0,
            )
            iterations += solver.stats()["iter_count"]
            controls = np.clip(np.asarray(solution["x"])[: self.horizon, 0], -limit, limit)
            error = float(errors_of(problem, controls[None])[0])
            rollouts += 1
            if error < best_error:
                best, best_error = controls, error
            if error <= TOLERANCE:
                break
            guess = {
                "x0": solution["x"],
                "lam_x0": solution["lam_x"],
                "lam_g0": solution["lam_g"],
            }
        return Answer(best, rollouts, iterations)


def _program(system: System, horizon: int) -> dict[str, Any]:
    """Return the nonlinear program over controls, positions and velocities."""
    controls, positions, velocities = (casadi.SX.sym(name, horizon) for name in "upv")
    parameters = casadi.SX.sym("parameters", 5)
    position, velocity, sharpness = parameters[0], parameters[1], parameters[4]
    defects = []
    plant = system.plant
    for k in range(horizon):
        after = velocities[k]
        peak = (plant.static_forward - plant.coulomb_forward) * casadi.exp(
            -((after / (3 * sharpness)) ** 2)
        )
        friction = (plant.coulomb_forward + peak) * casadi.tanh(after / sharpness)
        acceleration = controls[k] - friction - plant.damping_forward * velocity
        defects += [
            after - velocity - plant.time_step * acceleration,
            positions[k] - position - plant.time_step * after,
        ]
        position, velocity = positions[k], after
    arrival = [position - parameters[2], velocity - parameters[3]]
    return {
        "x": casadi.vertcat(controls, positions, velocities),
        "p": parameters,
        "f": casadi.sumsqr(controls),
        "g": casadi.vertcat(*defects, *arrival),
    }


def _solver(program: dict[str, Any], options: dict[str, Any]) -> Any:
    ipopt: dict[str, Any] = {"print_level": 0, "sb": "yes", "max_iter": 500} | options
    return casadi.nlpsol("smoothed", "ipopt", program, {"print_time": False, "ipopt": ipopt})


def planners() -> dict[str, Planner]:
    """Return every planner by its name in the table."""
    nominal = Problem(np.zeros(2), np.zeros(2), horizon=DEFAULT_HORIZON)
    smoothed = SmoothedFriction(nominal)
    return {
        "dataset prior, K = 16": proposed(DatasetPrior(), 16),
        "dataset prior, K = 16, refined": refined(DatasetPrior(), 16),
        "dataset prior, K = 1, refined": refined(DatasetPrior(), 1),
        "uniform, K = 16, refined": refined(Uniform(), 16),
        "CEM, 512 x 40": proposed(CEM(), 512),
        "CMA-ES": CMAES(),
        "IPOPT, friction smoothed": smoothed,
        "IPOPT, friction smoothed, refined": then_refined(smoothed),
        "IPOPT, first stage only, refined": then_refined(
            SmoothedFriction(nominal, SHARPNESSES[:1])
        ),
    }


def compare(num_tasks: int, seed: int) -> list[Row]:
    """Give every planner all tasks, after one to warm up on."""
    problems = tasks(num_tasks, seed)
    floors = [reachability(problem).floor for problem in problems]
    rows = []
    for name, planner in planners().items():
        planner(Problem(np.zeros(2), np.array([0.3, 0.0])), np.random.default_rng(seed))
        row = Row(name)
        for index, (problem, floor) in enumerate(zip(problems, floors, strict=True)):
            rng = np.random.default_rng((seed, index))
            started, processor_started = perf_counter(), process_time()
            answer = planner(problem, rng)
            row.processor_milliseconds.append((process_time() - processor_started) * 1e3)
            row.milliseconds.append((perf_counter() - started) * 1e3)
            row.gaps.append(float(errors_of(problem, answer.controls[None])[0]) - floor)
            row.rollouts.append(answer.rollouts)
            row.iterations.append(answer.iterations)
        rows.append(row)
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Compare the planners with general solvers.")
    parser.add_argument("--tasks", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(HEADER)
    for row in compare(arguments.tasks, arguments.seed):
        print(row)


if __name__ == "__main__":
    main()
