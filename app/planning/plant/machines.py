"""Real machines as plants, by name: what was published of them, per unit mass or inertia."""

from dataclasses import dataclass

from app.planning.plant.system import ByDirection, System

STATIC_OVER_COULOMB = 1.2
"""Where static friction was not published: logs of an axis that never rests do not tell it."""


@dataclass(frozen=True, slots=True)
class Machine:
    """A machine whose parameters are known."""

    name: str
    title: str
    system: System
    position_unit: str
    control_unit: str
    delay_steps: int
    """Time steps that a control takes to the actuator: `pending_controls` plans for them."""
    source: str
    """Who published the parameters, and what was assumed beside them."""


def _static(coulomb: ByDirection) -> ByDirection:
    """Return the static friction that is assumed where none was published."""
    return ByDirection(
        STATIC_OVER_COULOMB * coulomb.forward, STATIC_OVER_COULOMB * coulomb.backward
    )


_EMPS_COULOMB = ByDirection(0.2117, 0.2168)
_BELT_CART_COULOMB = ByDirection(0.196, 0.292)
_CART_POLE_COULOMB = ByDirection(0.93, 0.68)
_ASSUMED = f"static friction is assumed, {STATIC_OVER_COULOMB:g} times Coulomb friction"

_ALL = (
    Machine(
        "paper",
        "the paper's plant",
        System(),
        "m",
        "m/s²",
        0,
        "Table 2 of the paper.",
    ),
    Machine(
        "emps",
        "EMPS, a prismatic axis with a ball screw",
        System(
            static_friction=_static(_EMPS_COULOMB),
            coulomb_friction=_EMPS_COULOMB,
            viscous_damping=ByDirection(1.752, 2.527),
            control_gain=0.3694,
            control_limit=10.0,
            time_step=0.01,
        ),
        "m",
        "V",
        0,
        "Janot, Gautier and Brunot 2019, 'Data set and reference models of EMPS', the direction-"
        f"dependent model; {_ASSUMED}.",
    ),
    Machine(
        "belt_cart",
        "a cart of 6.3 kg on a belt",
        System(
            static_friction=_static(_BELT_CART_COULOMB),
            coulomb_friction=_BELT_CART_COULOMB,
            viscous_damping=0.80,
            control_gain=0.498,
            control_limit=4.0,
            time_step=0.02,
        ),
        "m",
        "A",
        0,
        "Least squares on the logs of a master's thesis at Aalborg University, 2018 "
        f"(github.com/nielsSkov/masterThesisMatlab); {_ASSUMED}.",
    ),
    Machine(
        "cart_pole",
        "the cart of a cart-pole, geared DC motor and belt",
        System(
            static_friction=_static(_CART_POLE_COULOMB),
            coulomb_friction=_CART_POLE_COULOMB,
            viscous_damping=13.05,
            control_gain=7.7,
            control_limit=1.0,
            time_step=0.02,
        ),
        "m",
        "duty",
        1,
        "github.com/SensorsINI/physical-cartpole: effective mass 2.82 kg, 21.7 N at full duty, "
        f"damping with back-EMF, the driver's dead band as Coulomb friction; {_ASSUMED}.",
    ),
    Machine(
        "rack_and_pinion",
        "a servo press rig with rack and pinion, 24.7 kg",
        System(
            static_friction=1.20,
            coulomb_friction=0.405,
            viscous_damping=2.73,
            stribeck_velocity=0.0135,
            control_limit=5.0,
            time_step=0.005,
        ),
        "m",
        "m/s²",
        0,
        "github.com/KonradMnich/friction-identification, a measured Stribeck curve; the control "
        "limit is not published, 5 m/s² is assumed.",
    ),
    Machine(
        "servo",
        "a Dynamixel MX-64 servo with 0.5 kg on an arm of 0.1 m, held level",
        System(
            static_friction=8.15,
            coulomb_friction=3.32,
            viscous_damping=41.0,
            bias=-29.0,
            control_gain=24.65,
            control_limit=14.4,
            time_step=0.005,
            velocity_threshold=0.01,
        ),
        "rad",
        "V",
        0,
        "github.com/Rhoban/bam, model M2 of the bare servo with the arm's inertia; back-EMF is in "
        "the damping, and the arm's weight is taken as constant, which it is near the level.",
    ),
)
MACHINES: dict[str, Machine] = {machine.name: machine for machine in _ALL}
