"""How fast iCEM's rollouts are on a model with effects, as a share of the speed without.

    python -m benchmarks.effects_speed [--samples 64] [--entries 8]

Rollouts of the default budget: sequences of commands that are held for four ticks, from one history, on an MLP Δq̇ and
on an NFIR model of random parameters and their default sizes. Models with and without effects take turns in one
process, so that whatever else the computer does falls on all; the best turn of each counts.
"""

import argparse
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.configuration.load import load_machine
from pipeline.dynamics.model.kinds import build_model, read_specification
from pipeline.dynamics.model.stops import Stops
from pipeline.effects.augmented_model import AugmentedModel, AugmentedParameters
from pipeline.effects.catalogue import IN_MODELS
from pipeline.effects.chain import Chain
from pipeline.effects.effect import Setting

CHAINS = (
    ("gain",), ("delay",), ("lag",), ("flow_coupling",), ("oscillation",), ("varying_speed",),
    ("delay", "flow_coupling", "lag"),
)  # fmt: skip
HELD, TURNS, CALLS = 4, 30, 5
MACHINE = load_machine("bobcat_e10")
N = MACHINE.n_joint


def model_of(kind: str, lags: int):
    common = {
        "parameterization": kind,
        "target": "dqdot",
        "hidden": [64, 64],
        "lags": lags,
        "legendre_degree": 3,
        "joints": list(MACHINE.joint_names),
        "rate_hz": MACHINE.rate_hz,
        "position_lower": list(MACHINE.lower),
        "position_upper": list(MACHINE.upper),
        "velocity_limit": [0.7] * N,
        "residual_scale": [0.02] * N,
    }
    of_nfir = {"members": 8, "member_hidden": [32, 32], "demand_beyond": [1, 2]}
    of_nfir |= {"stop_lower": [None] * N, "stop_upper": [None] * N}
    return build_model(read_specification(common | (of_nfir if kind == "nfir" else {})))


def rollouts_of(model, commands: jax.Array) -> dict[str, Callable[[], jax.Array]]:
    theta, q = (
        model.initialise(jax.random.key(0)),
        jnp.asarray(0.5 * (MACHINE.lower + MACHINE.upper), jnp.float32),
    )
    stops = Stops(np.float32(MACHINE.lower), np.float32(MACHINE.upper))
    setting = Setting(MACHINE.dt_s, MACHINE.lower, MACHINE.upper, np.full(N, 0.3))
    off = np.random.default_rng(0)
    of_each = {"none": (model, theta)}
    for families in CHAINS:
        chain = Chain([IN_MODELS[family] for family in families], setting)
        values = jax.tree.map(lambda v: jnp.float32(v + 0.1 * off.random(np.shape(v))), chain.neutral())
        of_each[", ".join(families)] = AugmentedModel(model, chain), AugmentedParameters(theta, values)

    def call(dynamics, parameters) -> Callable[[], jax.Array]:
        roll_out, history = (
            jax.jit(dynamics.held_rollout(parameters, HELD, stops)),
            dynamics.at_rest(parameters, q),
        )
        return lambda: roll_out(history, commands).block_until_ready()

    return {name: call(*of) for name, of in of_each.items()}


def best_s(calls: dict[str, Callable[[], jax.Array]]) -> dict[str, float]:
    best = {name: np.inf for name in calls}
    for turn in range(TURNS + 1):  # the first one compiles
        for name, call in calls.items():
            begin = time.perf_counter()
            for _ in range(CALLS):
                call()
            if turn:
                best[name] = min(best[name], (time.perf_counter() - begin) / CALLS)
    return best


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--entries", type=int, default=8)
    given = parser.parse_args()
    shape = (given.samples, given.entries, N)
    commands = jnp.asarray(np.random.default_rng(0).integers(-1, 2, shape), jnp.float32)
    for kind, lags in (("mlp", 18), ("nfir", 23)):
        best = best_s(rollouts_of(model_of(kind, lags), commands))
        print(f"{kind}: {1e3 * best['none']:.2f} ms without effects; share of that speed with")
        for name, seconds in best.items():
            print(f"  {best['none'] / seconds:4.0%}  {name}")


if __name__ == "__main__":
    main()
