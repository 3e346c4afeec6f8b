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
    Variant,
    direction_weights,
)

ALONE = ("loss_alone_positive", "loss_alone_negative")


class FlowCoupling(RatioEffect):
    """Speed falls with the demand of the other joints; a too small pump also slows a joint that moves alone."""

    passes = 12  # each at least halves the error, except in saturation
    card = Card(
        family="flow_coupling",
        equation="v_j = u_j (1 − Σ_{i≠j} λ_ji |u_i| / speed scale_i − μ_j±), μ± per direction of the joint",
        source="several actuators on one pump: Jelali and Kroll (2003), Hydraulic Servo-systems",
        signature="slower than nominal while other joints move, and hardly so alone; the loss grows with their number",
        confounded_with=("supply_variation", "load"),
        excitation="each pair of joints at once, and each joint alone",
        depends_on=("command",),
        scope=Scope.machine,
        complexity=2.5,
        drawn_over=Abscissa.other_commands,
        counted_along=Along.motion,
        parameters=(
            Parameter("loss_fraction", "1", 0.0, 0.0, 0.9, per_source=True),
            Parameter(ALONE[0], "1", 0.0, 0.0, 0.9),
            Parameter(ALONE[1], "1", 0.0, 0.0, 0.9),
        ),
    )

    def variants(self) -> list[Variant]:
        """With and without a loss of the joint that moves alone."""
        by_source: Variant = tuple((("loss_fraction", source),) for source in range(self.setting.n_joint))
        return [by_source, by_source + tuple(((name, None),) for name in ALONE)]

    def ratio(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """One minus the loss."""
        demand = jnp.minimum(jnp.abs(u) / self.setting.speed_scale, 1.5)
        loss = values["loss_fraction"] * (1.0 - jnp.eye(self.setting.n_joint))
        positive, negative = direction_weights(u)
        alone = values[ALONE[0]] * positive + values[ALONE[1]] * negative
        return state, 1.0 - jnp.minimum(jnp.einsum("...i,...ji->...j", demand, loss) + alone, 0.9)
