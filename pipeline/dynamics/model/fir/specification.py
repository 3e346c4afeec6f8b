"""What a nonlinear finite-impulse-response model is besides its parameters."""

from dataclasses import dataclass

import numpy as np

from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.model.specification import ModelSpecification, Target
from pipeline.errors import InputError


@dataclass
class FirSpecification(ModelSpecification):
    """More than `ModelSpecification`; `residual_scale` is that of velocities.

    Attributes:
        members: Networks of the ensemble.
        member_hidden: Units per hidden layer of a member.
        demand_beyond: Numbers that Σ|a| may exceed; by how much is an input. Of proportional commands, whose sum says
            little of what valves let through, there are none.
        stop_lower: Where a joint ends, rad or m; null: nowhere that logs have shown.
        stop_upper: The same above.
    """

    members: int
    member_hidden: list[int]
    demand_beyond: list[int]
    stop_lower: list[float | None]
    stop_upper: list[float | None]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.parameterization is not Parameterization.nfir or self.target is not Target.dqdot:
            raise InputError(f"model: {self.kind} is no kind; an nfir model has target dqdot")
        if self.members < 2:
            raise InputError(f"model: members is {self.members}; an ensemble has at least 2")
        if not self.member_hidden or min(self.member_hidden) < 1:
            raise InputError(
                f"model: member_hidden is {self.member_hidden}; list at least one layer, each of at least one unit"
            )
        if min(self.demand_beyond, default=0) < 0:
            raise InputError(f"model: demand_beyond is {self.demand_beyond}; no number may be negative")
        for name in ("stop_lower", "stop_upper"):
            if len(getattr(self, name)) != self.n_joint:
                raise InputError(
                    f"model: {name} has {len(getattr(self, name))} values for {self.n_joint} joints"
                )

    def stops(self) -> tuple[np.ndarray, np.ndarray]:
        """(n_joint,) lower and upper stops; infinite where there are none."""
        lower = [-np.inf if stop is None else stop for stop in self.stop_lower]
        upper = [np.inf if stop is None else stop for stop in self.stop_upper]
        return np.array(lower), np.array(upper)
