"""`flow_coupling`: a joint loses speed while others draw on the shared supply."""

import jax
import jax.numpy as jnp

from pipeline.effects.effect import (
    Abscissa,
    Along,
    Card,
    Parameter,
    RatioEffect,
    Scope,
    Signals,
    State,
    Values,
)


class FlowCoupling(RatioEffect):
    """Speed falls with the demand of the other joints."""

    passes = 12  # each halves the error at least, short of saturation
    card = Card(
        family="flow_coupling",
        equation="v_j = u_j (1 − Σ_{i≠j} λ_ji |u_i| / speed scale_i)",
        source="several actuators on one pump: Jelali and Kroll (2003), Hydraulic Servo-systems",
        signature="slower than nominal only while other joints move; the loss grows with their number",
        confounded_with=("supply_variation", "load"),
        excitation="each pair of joints at once, and each joint alone",
        depends_on=("command",),
        scope=Scope.machine,
        complexity=2.5,
        drawn_over=Abscissa.other_commands,
        counted_along=Along.motion,
        parameters=(Parameter("loss_fraction", "1", 0.0, 0.0, 0.9, per_source=True),),
    )

    def ratio(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """One minus the loss."""
        demand = jnp.minimum(jnp.abs(u) / self.setting.speed_scale, 1.5)
        loss = values["loss_fraction"] * (1.0 - jnp.eye(self.setting.n_joint))
        return state, 1.0 - jnp.minimum(jnp.einsum("...i,...ji->...j", demand, loss), 0.9)
