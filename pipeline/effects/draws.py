"""Values of effects drawn from what logs leave open of them."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.effects.catalogue import IN_MODELS
from pipeline.effects.chain import ChainValues
from pipeline.effects.store import ActiveEffects

OF_95_PERCENT = 1.96  # standard deviations of a normal variable either side of its mean


class EffectDraws:
    """A normal variable per fitted value, cut off at its 95 % interval and at the bounds of its card."""

    def __init__(self, effects: ActiveEffects) -> None:
        """Effects with their deviations; a value without one is always the same."""
        self._values, self._deviations, self._bounds = {}, {}, {}
        for family in effects.families():
            of, wrapper = effects.values[family], IN_MODELS[family](effects.setting)
            deviations = effects.deviations.get(family, {})
            self._values[family] = {name: np.asarray(value, np.float32) for name, value in of.items()}
            self._deviations[family] = {
                name: np.asarray(deviations.get(name, np.zeros_like(value)), np.float32)
                for name, value in of.items()
            }
            self._bounds[family] = {
                parameter.name: (sizes * parameter.lower, sizes * parameter.upper)
                for parameter in wrapper.card.parameters
                for sizes in [_along(wrapper.sizes(parameter.name), of[parameter.name])]
            }

    @property
    def is_certain(self) -> bool:
        """Whether every draw is the same."""
        return not any(np.any(value) for of in self._deviations.values() for value in of.values())

    def draw(self, key: jax.Array) -> ChainValues:
        """Values by family and parameter, (n_joint, ...), float32; `key` is consumed."""
        drawn: dict[str, Mapping[str, jax.Array]] = {}
        for family, of in self._values.items():
            keys = jax.random.split(jax.random.fold_in(key, len(drawn)), len(of))
            drawn[family] = {name: self._one(family, name, own) for own, name in zip(keys, of, strict=True)}
        return drawn

    def _one(self, family: str, name: str, key: jax.Array) -> jax.Array:
        value, deviation = self._values[family][name], self._deviations[family][name]
        normal = jax.random.truncated_normal(key, -OF_95_PERCENT, OF_95_PERCENT, value.shape)
        drawn = jnp.asarray(value) + deviation * normal
        if name in self._bounds[family]:
            lower, upper = self._bounds[family][name]
            # what was fitted may lie on a bound, or beyond it by rounding: it stays
            drawn = jnp.clip(drawn, np.minimum(lower, value), np.maximum(upper, value))
        return drawn


def _along(sizes: np.ndarray, value: np.ndarray) -> np.ndarray:
    """(n_joint,) with the axes of a value (n_joint, ...)."""
    return sizes.reshape(-1, *([1] * (np.ndim(value) - 1)))
