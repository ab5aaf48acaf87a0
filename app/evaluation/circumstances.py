"""What disturbs a closed loop in the evaluation, by name: forces, sensors and delays.

What the controllers do about it is in controllers.py.
"""

from dataclasses import dataclass, field, replace

from app.planning.control.observer import Identification, Observer
from app.planning.control.simulation import Disturbance, Pulse, Sensor

STEPS = 128
"""Of a run."""
PULSES = (Pulse(40, 5, 1.5), Pulse(80, 5, -1.5))
POSITION_NOISE, VELOCITY_NOISE = 1e-3, 1e-2
"""m and m/s."""
MEASURED = Sensor(POSITION_NOISE, VELOCITY_NOISE)
LEAST_FORCES = 0.002
"""m/s^2: what an observer takes for unknown forces where there are none, the sensor being exact."""
NOISY_FORCES = 0.02
"""m/s^2: the same with a noisy sensor."""
MODEL_ERROR = 0.06
"""m/s^2: the same where it does not learn what the model has wrong, a tenth of the friction."""


@dataclass(frozen=True, slots=True)
class Circumstances:
    """What a run is disturbed by."""

    title: str
    disturbance: Disturbance = field(default_factory=Disturbance)
    sensor: Sensor = field(default_factory=Sensor)
    delay_steps: int = 0
    """Known to the controllers."""

    def observer(self, *, identifies: bool) -> Observer:
        """Return an observer that is told the noise as it is."""
        sensor = self.sensor
        is_noisy = sensor.position_noise > 0.0
        least = NOISY_FORCES if is_noisy else LEAST_FORCES
        forces = max(least, self.disturbance.acceleration_noise)
        return Observer(
            sensor.position_noise,
            sensor.velocity_noise,
            sensor.position_step,
            forces if identifies else max(forces, MODEL_ERROR),
            Identification() if identifies else None,
        )


UNDISTURBED = Circumstances("none")
CIRCUMSTANCES = {
    "none": UNDISTURBED,
    "process-0.05": Circumstances("process noise 0.05 m/s²", Disturbance(0.05)),
    "process-0.2": Circumstances("process noise 0.2 m/s²", Disturbance(0.2)),
    "measured": Circumstances("noise 1 mm, 1 cm/s", sensor=MEASURED),
    "position-only": Circumstances(
        "positions alone, 1 mm", sensor=replace(MEASURED, measures_velocity=False)
    ),
    "delay": Circumstances("a step of delay", delay_steps=1),
    "pulses": Circumstances("two pulses of 1.5 m/s²", Disturbance(0.0, PULSES)),
    "all": Circumstances("noise 0.1 m/s², measured, pulses", Disturbance(0.1, PULSES), MEASURED),
}
