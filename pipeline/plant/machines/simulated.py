"""Which machines have a simulated stand-in."""

from collections.abc import Callable

from pipeline.errors import InputError
from pipeline.plant.machines.bobcat_e10 import bobcat_e10
from pipeline.plant.parameters import Parameters

SIMULATED: dict[str, Callable[[], Parameters]] = {"bobcat_e10": bobcat_e10}


def simulated_machine(name: str) -> Parameters:
    """Nominal quantities of the machine's plant.

    Raises:
        InputError: this machine's hydraulics are not described.
    """
    if name not in SIMULATED:
        raise InputError(
            f"machine={name}: there is no simulated plant of it (known: {', '.join(SIMULATED)}); name recorded "
            f"logs with logs=DIR instead"
        )
    return SIMULATED[name]()
