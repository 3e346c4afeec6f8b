"""A plant whose parameters change, and whose engine is stopped and started, while it is recorded."""

from collections.abc import Sequence

from pipeline.plant.machines.field import Shift
from pipeline.plant.parameters import Parameters
from pipeline.plant.simulator import Plant


def started(parameters: Parameters, shift: Shift | None, n_starts: int) -> Parameters:
    """The machine after so many starts of its engine; without a shift they are all alike."""
    return parameters if shift is None else shift.started(parameters, n_starts)


class AttendedPlant:
    """Does to a plant what is due.

    Attributes:
        off_s: How long the engine has been off, s, which the plant's clock does not count.
    """

    def __init__(
        self,
        plant: Plant,
        parameters: Parameters,
        changes: Sequence[tuple[float, Parameters]],
        shift: Shift | None,
    ) -> None:
        """A plant of `parameters` after its first start; `changes` are later ones, each with when it sets in, s."""
        self._plant, self._parameters, self._shift = plant, parameters, shift
        self._changes, self._pauses = list(changes), list(shift.pauses if shift else ())
        self._n_starts = 1
        self.off_s = 0.0

    def attend(self, is_at_rest: bool) -> None:
        """Before a control period; the engine is stopped only where no command was in force for a second."""
        plant = self._plant
        while self._changes and plant.time_s >= self._changes[0][0]:
            self._parameters = self._changes.pop(0)[1]
            plant.change(started(self._parameters, self._shift, self._n_starts))
        if self._pauses and is_at_rest and plant.time_s >= self._pauses[0][0]:
            pause_s = self._pauses.pop(0)[1]
            plant.stop_engine(pause_s)
            self.off_s += pause_s
            self._n_starts += 1
            plant.change(started(self._parameters, self._shift, self._n_starts))
