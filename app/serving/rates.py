"""How fast work gets done here, measured as it is done."""

from typing import TYPE_CHECKING

from app.inference.model_card import ModelCard

if TYPE_CHECKING:
    from app.inference.engine import Tick

SECONDS_PER_STEP = 2e-8
"""Of a simulated time step, before the first plan of a kind: a guess, rather too long."""
PRIOR_ROWS = 1000
"""As many rows weigh as much as what was measured when the model was loaded."""
PRIOR_STEPS = 1_000_000
CROWDED = 2.0
"""How much longer a row takes while cores are lent, before the first such measurement."""
MEMORY = 0.95
"""What each new measurement leaves of the weight of those before."""


class Rate:
    """Seconds for a unit of work: a mean of what it took, the latest weighing most."""

    def __init__(self, seconds_per_unit: float, units: float) -> None:
        self._seconds = seconds_per_unit * units
        self._units = units

    def add(self, seconds: float, units: float) -> None:
        """Count a measurement."""
        self._seconds = MEMORY * self._seconds + seconds
        self._units = MEMORY * self._units + units

    @property
    def seconds_per_unit(self) -> float:
        return self._seconds / self._units


class Rates:
    """The rates of each model's rows, and of simulated time steps by kind of plan."""

    def __init__(self) -> None:
        self._rows: dict[tuple[str, bool], Rate] = {}
        self._steps: dict[str, Rate] = {}

    def add_tick(self, tick: "Tick") -> None:
        """Count a batch of the engine."""
        self._of(tick.model, tick.is_crowded).add(tick.seconds, tick.rows)

    def add_steps(self, kind: str, seconds: float, steps: int) -> None:
        """Count the simulated time steps of a plan."""
        self._steps.setdefault(kind, Rate(SECONDS_PER_STEP, PRIOR_STEPS)).add(seconds, steps)

    @property
    def seconds_per_step(self) -> dict[str, float]:
        """Of simulated time steps, by kind of plan: of those that were measured."""
        return {kind: rate.seconds_per_unit for kind, rate in self._steps.items()}

    def seconds_of_rows(self, model: ModelCard, rows: int, *, is_crowded: bool) -> float:
        """Return about how long that many rows take, alone or beside long compiled plans."""
        return rows * self._of(model, is_crowded).seconds_per_unit

    def seconds_of_steps(self, kind: str, steps: int) -> float:
        """Return about how long that many simulated time steps of a plan take."""
        rate = self._steps.get(kind)
        return steps * (rate.seconds_per_unit if rate else SECONDS_PER_STEP)

    def _of(self, model: ModelCard, is_crowded: bool) -> Rate:
        rate = self._rows.get((model.label, is_crowded))
        if rate is None:
            seconds = model.pace.seconds_per_row * (CROWDED if is_crowded else 1.0)
            rate = self._rows[model.label, is_crowded] = Rate(seconds, PRIOR_ROWS)
        return rate
