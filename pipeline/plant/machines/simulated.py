"""Which machines have a simulated stand-in, and in which condition."""

import enum
from collections.abc import Callable

from pipeline.errors import InputError
from pipeline.plant.machines.bobcat_e10 import bobcat_e10
from pipeline.plant.machines.field import in_the_field
from pipeline.plant.parameters import Parameters

SIMULATED: dict[str, Callable[[], Parameters]] = {"bobcat_e10": bobcat_e10}


class Condition(enum.StrEnum):
    """Of a simulated machine."""

    workshop = "workshop"  # looked after, alone on its pump, warm
    field = "field"  # see `field.py`


def simulated_machine(name: str, condition: Condition = Condition.workshop) -> Parameters:
    """Nominal quantities of the machine's plant.

    Raises:
        InputError: this machine's hydraulics are not described.
    """
    if name not in SIMULATED:
        raise InputError(
            f"machine={name}: there is no simulated plant of it (known: {', '.join(SIMULATED)}); name recorded "
            f"logs with logs=DIR instead"
        )
    parameters = SIMULATED[name]()
    return in_the_field(parameters) if condition is Condition.field else parameters
