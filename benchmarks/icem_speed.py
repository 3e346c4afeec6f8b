"""How long iCEM plans for one decision, beside the published algorithm written plainly, and the processor's peak.

    python benchmarks/icem_speed.py [--torch-python PATH]

The paper's parameters (profile `paper`): 500 samples, decaying, 12 iterations, 20 entries; dynamics MLP(512, 128) on
Δq̇ with 18 lags, of random parameters; the paper's three rewards. Once 20 single ticks, once 20 entries held for
four ticks: 80 model steps. Ours, and iCEM in NumPy loops with rollouts in NumPy or PyTorch (icem_speed_pytorch.py),
each in a process of its own with the same processors; the processes take turns, as in identification_speed.py.
Run it on a machine that does nothing else. Where there are others, `--threads 1 --processor-time` counts the time
that a process had on its one processor. First it is checked that all give the same sequences the same returns.

Needed floating-point operations of one decision: 2 Σ (rows n_1 + n_1 n_2 + n_2 n_joint) over ticks and sequences,
where `rows` are the first layer's inputs that differ between sequences: the predicted rows of the motion window,
one row per joint and entry in the window of commands, and the configuration. The share of the peak is their rate over
that of a large matrix product in the same run; what activations, kinematics and rewards take is left out.

PATH: a Python with PyTorch (requirements-benchmark.lock); without it NumPy's side runs in this Python.
"""

import argparse
import contextlib
import dataclasses
import json
import os
import statistics
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from identification_speed import Turns, case_of, model_of, rate_of, serve, serve_peak, take_turns

HIDDEN = [512, 128]
VARIANT = "icem"  # the full reward: every term has to be computed
N_CHECKED = 50
SAME = 2e-3  # relative to the spread of the returns; one of them may sit on a threshold's edge
GOAL_S, GOAL_TICKS = 0.2, 20


def parts(held: bool):
    from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine, load_section
    from pipeline.control.icem.config import IcemConfig
    from pipeline.machine.kinematics import load_arm
    from pipeline.reaching.reward import RewardConfig

    machine = load_machine("bobcat_e10")
    config = dataclasses.replace(load_section("icem", IcemConfig), held_entries=held)
    return machine, load_arm(machine, MACHINE_DIRECTORY), config, load_section("reward", RewardConfig)


def task_and_state(machine, arm, reward):
    """The task, and a state in motion."""
    import jax
    import jax.numpy as jnp

    from pipeline.dynamics.model.dynamics_model import DynamicsModel
    from pipeline.reaching.task import ReachingTask

    specification = model_of(case_of("mlp", HIDDEN)).specification
    model = DynamicsModel(
        dataclasses.replace(
            specification,
            joints=list(machine.joint_names),
            position_lower=list(machine.lower),
            position_upper=list(machine.upper),
        )
    )
    task = ReachingTask(machine, arm, model, model.initialise(jax.random.key(0)), reward)
    random = np.random.default_rng(0)
    middle, width = (machine.lower + machine.upper) / 2, machine.upper - machine.lower
    state = task.begin(
        *(jnp.asarray(middle + 0.2 * width * random.uniform(-1, 1, 4), jnp.float32) for _ in range(2))
    )
    history = state.history
    history = history._replace(
        motion=jnp.asarray(random.normal(0, 0.1, history.motion.shape), jnp.float32),
        commands=jnp.asarray(random.integers(-1, 2, history.commands.shape), jnp.float32),
    )
    return task, state._replace(history=history, command=history.commands[-1])


def checked_commands(horizon: int) -> np.ndarray:
    return np.random.default_rng(1).integers(-1, 2, (N_CHECKED, horizon, 4)).astype(np.float32)


def write_case(path: Path, held: bool) -> None:
    """All that the plain side needs, as arrays."""
    machine, arm, config, reward = parts(held)
    task, state = task_and_state(machine, arm, reward)
    specification, workspace = task.dynamics.specification, machine.workspace
    *moving, tip = arm.joints  # in the machine's order, and the tip's fixed frame
    layers = task.dynamics.network.layers(task.parameters)
    scalars = {
        "icem": dataclasses.asdict(config),
        "reward": {k: v for k, v in dataclasses.asdict(reward).items() if k != "terms"},
        "workspace": dataclasses.asdict(workspace),
        "held_ticks": config.ticks_per_entry(4),
        "shift": config.entries_per_decision(4),
        "pitch_offset_rad": machine.arm.pitch_offset_rad,
        "dt_s": specification.dt_s,
    }
    np.savez(
        path,
        scalars=json.dumps(scalars),
        lower=np.float32(machine.lower),
        upper=np.float32(machine.upper),
        velocity_limit=np.float32(specification.velocity_limit),
        residual_scale=np.float32(specification.residual_scale),
        body_position=np.float32([joint.position for joint in moving]),
        body_quaternion=np.float32([joint.quaternion for joint in moving]),
        axis=np.float32([joint.axis for joint in moving]),
        tip_position=np.float32(tip.position),
        tip_quaternion=np.float32(tip.quaternion),
        motion=state.history.motion,
        commands=state.history.commands,
        q=state.history.q,
        previous=state.command,
        goal=state.goal.configuration,
        checked=checked_commands(config.horizon),
        **{f"kernel_{i}": layer.kernel for i, layer in enumerate(layers)},
        **{f"bias_{i}": layer.bias for i, layer in enumerate(layers)},
    )


def our_planner(held: bool, variant: str) -> tuple[dict, Callable[[int], float]]:
    """What the process says first, and its turn: so many decisions."""
    import jax
    import jax.numpy as jnp

    from pipeline.control.icem.controller import icem_planner
    from pipeline.control.icem.returns import sequence_returns
    from pipeline.control.icem.variant import RewardVariant, variant_reward

    machine, arm, config, reward = parts(held)
    task, state = task_and_state(machine, arm, variant_reward(reward, RewardVariant(variant)))
    returns = sequence_returns(task, config.ticks_per_entry(4), config.discount)
    planner = icem_planner(task, config, 4, returns)
    first = jax.jit(returns)(state, jnp.asarray(checked_commands(config.horizon)))
    decide = jax.jit(planner.decide)
    # A state with elites: the first decision of an episode is not the usual one.
    planning, _ = decide(planner.begin(jax.random.key(0)), state)
    answer = {"returns": np.asarray(first, float).tolist(), "name": jax.__version__}
    return answer, rate_of(lambda: decide(planning, state), 1.0)


def operations(held: bool) -> float:
    """Of one decision; see above."""
    _, _, config, _ = parts(held)
    ticks, lags, n_joint = config.ticks_per_entry(4), 18, 4
    total = 0
    for tick in range(config.horizon * ticks):
        motion = min(tick, lags + 1)
        oldest = max(0, tick - lags) // ticks
        entries = tick // ticks - oldest + 1
        rows = n_joint * (motion + entries + 1)
        total += rows * HIDDEN[0] + HIDDEN[0] * HIDDEN[1] + HIDDEN[1] * n_joint
    return 2.0 * total * config.sequences_per_decision


def ours(what: str, held: bool, variant: str) -> Turns:
    return Turns([sys.executable, __file__, "--serve", what, str(int(held)), variant])


def compare(held: bool, arguments: argparse.Namespace, folder: Path) -> None:
    _, _, config, _ = parts(held)
    ticks = config.horizon * config.ticks_per_entry(4)
    case = folder / "case.npz"
    write_case(case, held)
    plain = str(Path(__file__).with_name("icem_speed_pytorch.py"))
    python = arguments.torch_python or sys.executable
    servers = {
        "peak": ours("peak", held, VARIANT),
        "this project": ours("planner", held, VARIANT),
        **{f"this project, {reward}": ours("planner", held, reward) for reward in arguments.rewards},
        "plain, NumPy": Turns([python, plain, str(case), "numpy"]),
    }
    if arguments.torch_python:
        servers["plain, PyTorch"] = Turns([python, plain, str(case), "torch"])
    expected = np.array(servers["this project"].first["returns"])
    for name, server in servers.items():
        if name.startswith("plain"):
            apart = np.abs(np.array(server.first["returns"]) - expected)
            if np.median(apart) > SAME * np.ptp(expected) or (apart > SAME * np.ptp(expected)).sum() > 2:
                raise SystemExit(f"{name}: returns differ by up to {apart.max()}")
    take_turns(servers, arguments.seconds, arguments.turn_seconds)
    peak, needed = max(servers.pop("peak").rates), operations(held)
    print(
        f"\n{ticks} ticks ({config.horizon} entries of {ticks // config.horizon}), "
        f"{config.sequences_per_decision} sequences per decision"
    )
    print(
        f"  {needed / 1e9:.1f} GFLOP needed; peak {peak / 1e9:.0f} GFLOP/s, so at least {1e3 * needed / peak:.0f} ms"
    )
    print(f"  {'':34s} ms best  median  share of peak  slower than this project, best")
    best = max(servers["this project"].rates)
    for label, server in servers.items():
        rate, median = max(server.rates), statistics.median(server.rates)
        print(
            f"  {label + ' ' + server.first['name']:34s} {1e3 / rate:7.0f} {1e3 / median:7.0f} "
            f"{rate * needed / peak:14.0%} {best / rate:20.1f}"
        )
    if ticks == GOAL_TICKS:
        print(f"  goal: {1e3 * GOAL_S:.0f} ms; {'met' if 1 / best <= GOAL_S else 'not met'} by the best turn")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--torch-python", help="a Python with PyTorch")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument(
        "--processor-time", action="store_true", help="instead of wall time; with --threads 1"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="of measuring per length of the plan")
    parser.add_argument("--turn-seconds", type=float, default=1.0, help="of one process at a time")
    parser.add_argument("--ticks", nargs="*", type=int, default=[20, 80], choices=[20, 80])
    parser.add_argument(
        "--rewards", nargs="*", default=["icem_dagger", "icem_double_dagger"], help="beside the full one"
    )
    parser.add_argument("--serve", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        what, held, variant = arguments.serve
        if what == "peak":
            serve_peak({}, Path())
        else:
            # Brax prints while it is imported; answers are JSON alone.
            with contextlib.redirect_stdout(sys.stderr):
                answer, turn = our_planner(bool(int(held)), variant)
            serve(answer, turn)
        return
    if arguments.processor_time:
        os.environ["SPEED_CLOCK"] = "processor"
    # Inherited by all processes: all libraries take as many threads as there are processors.
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: arguments.threads])
    os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = str(arguments.threads)
    clock = "processor" if arguments.processor_time else "wall"
    print(f"{arguments.threads} processors, {clock} time; load before: {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        for ticks in arguments.ticks:
            compare(ticks == 80, arguments, Path(folder))
    print(f"load after: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
