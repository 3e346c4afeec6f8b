"""`sensor_bias`: encoder offset or scale."""

import jax

from pipeline.effects.effect import Abscissa, Along, Card, Parameter, Scope, SensorEffect, Values


class SensorBias(SensorEffect):
    """The encoder reads scale · q + offset."""

    card = Card(
        family="sensor_bias",
        equation="q_measured = k q + o",
        source="encoder mounting and coupling errors",
        signature="stops and all other effects of position move; a scale also changes measured speeds, both ways alike",
        confounded_with=("gain", "end_cushion", "load", "backlash"),
        excitation="both stops of the joint",
        depends_on=("position:{joint}",),
        scope=Scope.joint,
        complexity=1.3,
        drawn_over=Abscissa.position,
        counted_along=Along.axis,
        parameters=(
            Parameter(
                "offset",
                "length",
                0.0,
                -0.5,
                0.5,
                grid=(
                    -0.25,
                    -0.17,
                    -0.12,
                    -0.08,
                    -0.05,
                    -0.03,
                    -0.015,
                    0.015,
                    0.03,
                    0.05,
                    0.08,
                    0.12,
                    0.17,
                    0.25,
                ),
            ),
            Parameter(
                "scale",
                "1",
                1.0,
                0.7,
                1.4,
                grid=(0.79, 0.86, 0.9, 0.93, 0.96, 0.98, 1.02, 1.04, 1.07, 1.1, 1.14, 1.2, 1.27),
            ),
        ),
    )

    def grid(self) -> list[dict[str, float]]:
        """An offset or a scale."""
        return [{parameter.name: value} for parameter in self.card.parameters for value in parameter.grid]

    def measured(self, values: Values, q: jax.Array) -> jax.Array:
        """Reading of the encoder."""
        return q + ((values["scale"] - 1.0) * q + values["offset"])

    def true(self, values: Values, q: jax.Array) -> jax.Array:
        """True configuration of a reading."""
        return q - (values["offset"] + (values["scale"] - 1.0) * q) / values["scale"]
