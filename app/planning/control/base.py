"""What a controller is: a name, options, and what the kernels need of both for a model."""

from collections.abc import Hashable
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Protocol

from annotated_types import Gt, Le

from app.planning.control.observer import LEAST_DEAD_BAND, Observer
from app.planning.control.settings import SEQUENCE, Settings
from app.planning.options import Options
from app.planning.plant.system import Plant


class Controller(Hashable, Protocol):
    """State in, control and new state out. An instance is a controller with its options."""

    @property
    def name(self) -> str: ...

    @property
    def observer(self) -> Observer | None: ...

    def settings(self, model: Plant) -> Settings:
        """Return what the kernels need to control a machine of which `model` is believed."""
        ...


@dataclass(frozen=True, slots=True)
class Law(Options):
    """What all controllers have."""

    _: KW_ONLY
    observer: Observer | None = field(default_factory=Observer)
    """A filter of what is measured, which may learn; none: the measurement is the state."""
    dead_band: Annotated[float, Gt(0), Le(1e6)] | None = None
    """m: at rest nearer than this to the target the mass is held. By default three times the
    observer's position noise, and 0.3 mm at least."""

    def _watching(self, model: Plant) -> Settings:
        """Return the settings of the observer and the dead band."""
        observer = self.observer
        finest = observer.dead_band if observer else LEAST_DEAD_BAND
        settings = Settings(
            SEQUENCE,
            dead_band=self.dead_band or finest,
            rest_velocity=model.velocity_threshold,
        )
        if observer is None:
            return settings
        settings = settings._replace(
            observes=True,
            position_variance=observer.position_std**2,
            position_lag=observer.position_lag,
            velocity_variance=observer.velocity_std**2,
            acceleration_noise=observer.acceleration_noise,
            rest_velocity=observer.rest_velocity(model),
        )
        identification = observer.identification
        return identification.within(settings, model) if identification else settings
