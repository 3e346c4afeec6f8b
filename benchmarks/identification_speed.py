"""How fast dynamics models are trained and rolled out, beside the same in PyTorch and the processor's peak.

    python benchmarks/identification_speed.py [--torch-python PATH] [--tuples DIR]

Training: the Δq̇ model with lags 18, horizon 16, batches of 256 (the paper's), on random rows; this project,
PyTorch eager and PyTorch compiled, each in a process of its own with the same processors. The processes take
turns, so that whatever else the machine does falls on all of them; the best and the median turn are printed.
Run it on a machine that does nothing else: with two threads PyTorch waits for its slower one, so it suffers more
from other processes than this project does. Where there are others, `--threads 1 --processor-time` divides by
the time that a process had on its one processor.
First it is checked that all three compute the same loss and gradient.

Needed floating-point operations of one training step, from n_l × n_{l+1} multiply-adds of layer l (all layers
in the forward pass and again for the kernels' gradients; for the inputs' gradients all but the first layer,
of which only the motion and the configuration count):

    2 · batch · horizon · (2 Σ_l n_l n_{l+1} + Σ_{l≥1} n_l n_{l+1} + n_joint (lags + 2) n_1)

For the KAN n_l is multiplied by its degree, and what evaluating the basis takes is left out. The share of the
peak is their rate over that of the best large matrix product seen in the run (either library).

PATH: a Python with PyTorch (requirements-benchmark.lock); without it only this project is measured.
DIR: tuples of stage `ingest`; with them the default profile's training is timed to a given L|eval, too.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

LAGS, HORIZON, BATCH_SIZE, N_JOINT = 18, 16, 256, 4
LEGENDRE_DEGREE, LEARNING_RATE = 4, 1e-3
NETWORKS = {"mlp 512,128": ("mlp", [512, 128]), "mlp 64,64": ("mlp", [64, 64])}
NFIR = {"nfir 64,64": ("nfir", [64, 64])}  # predictions alone; lags as in the profiles
NFIR_LAGS = 23
KAN = {"kan 32,32,16": ("kan", [32, 32, 16]), "kan 16,16": ("kan", [16, 16])}
N_BATCHES = 20  # in the random rows; an epoch
ROLLOUTS, ROLLOUT_STEPS = 4096, 80
ENVIRONMENTS, ENVIRONMENT_STEPS = 512, 50
PEAK_SIZE = 1024
EVALUATION_LOSS = 1.5e-3  # L|eval to reach; the default profile ends at 1.0e-3
CLOCK = time.process_time if os.environ.get("SPEED_CLOCK") == "processor" else time.perf_counter
SAME = 1e-4  # relative difference of loss and gradient norm that rounding may cause


def case_of(parameterization: str, hidden: list[int]) -> dict:
    return {
        "parameterization": parameterization,
        "hidden": hidden,
        "lags": NFIR_LAGS if parameterization == "nfir" else LAGS,
        "horizon": HORIZON,
        "batch_size": BATCH_SIZE,
        "learning_rate": LEARNING_RATE,
        "dt_s": 0.05,
        "lower": [-1.0, -0.5, -2.0, -2.5],
        "upper": [1.0, 1.0, -0.5, 0.5],
        "velocity_limit": [0.4, 0.3, 0.5, 0.6],
        "residual_scale": [0.02, 0.01, 0.02, 0.03],
    }


def training_operations(parameterization: str, hidden: list[int]) -> float:
    """Per training step; see above."""
    expansion = LEGENDRE_DEGREE if parameterization == "kan" else 1
    widths = [2 * N_JOINT * (LAGS + 1) + N_JOINT, *hidden, N_JOINT]
    products = [expansion * n_in * n_out for n_in, n_out in pairwise(widths)]
    back_to_motion = expansion * N_JOINT * (LAGS + 2) * widths[1]
    return 2.0 * BATCH_SIZE * HORIZON * (2 * sum(products) + sum(products[1:]) + back_to_motion)


def model_of(case: dict):
    from pipeline.dynamics.model.kinds import build_model, read_specification

    content = {
        "parameterization": case["parameterization"],
        "target": "dqdot",
        "hidden": case["hidden"],
        "lags": case["lags"],
        "legendre_degree": LEGENDRE_DEGREE,
        "joints": [f"joint_{number}" for number in range(N_JOINT)],
        "rate_hz": 1.0 / case["dt_s"],
        "position_lower": case["lower"],
        "position_upper": case["upper"],
        "velocity_limit": case["velocity_limit"],
        "residual_scale": case["residual_scale"],
    }
    if case["parameterization"] == "nfir":
        stops = {"stop_lower": case["lower"], "stop_upper": case["upper"]}
        content |= {"members": 2, "member_hidden": [1], "demand_beyond": [1, 2]} | stops
    return build_model(read_specification(content))


def write_data(path: Path, case: dict) -> None:
    """Random rows, every window's start, and initial parameters as matrices."""
    import jax

    random = np.random.default_rng(0)
    n_rows = LAGS + 1 + N_BATCHES * BATCH_SIZE + HORIZON
    model = model_of(case)
    layers = model.network.layers(model.initialise(jax.random.key(0)))
    np.savez(
        path,
        q=random.uniform(case["lower"], case["upper"], (n_rows, N_JOINT)).astype(np.float32),
        qd=random.normal(0.0, 0.2, (n_rows, N_JOINT)).astype(np.float32),
        a=random.integers(-1, 2, (n_rows, N_JOINT)).astype(np.float32),
        starts=np.arange(LAGS + 1, LAGS + 1 + N_BATCHES * BATCH_SIZE, dtype=np.int32),
        **{f"kernel_{number}": layer.kernel for number, layer in enumerate(layers)},
        **{f"bias_{number}": layer.bias for number, layer in enumerate(layers)},
    )


def serve(first: dict, turn: Callable[[int], float]) -> None:
    """Say `first`, then answer each line on standard input, a number of repetitions, with a rate."""
    print(json.dumps(first), flush=True)
    for line in sys.stdin:
        print(json.dumps({"per_second": turn(int(line))}), flush=True)


def rate_of(call: Callable, count: float) -> Callable[[int], float]:
    """A turn: `call` so many times, and `count` things per call."""
    import jax

    jax.block_until_ready(call())

    def turn(repetitions: int) -> float:
        begin = CLOCK()
        for _ in range(repetitions):
            result = call()
        jax.block_until_ready(result)
        return repetitions * count / (CLOCK() - begin)

    return turn


def serve_training(case: dict, data_file: Path) -> None:
    import jax
    import jax.numpy as jnp
    import optax

    from pipeline.dynamics.training.epoch import compile_epoch
    from pipeline.dynamics.training.loss import open_loop_loss, prediction_loss
    from pipeline.dynamics.training.windows import TrainingRows, gather_windows

    model = model_of(case)
    with np.load(data_file) as data:
        rows = TrainingRows(*(jnp.asarray(data[name]) for name in ("q", "qd", "a")))
        starts = jnp.asarray(data["starts"])
    parameters = model.initialise(jax.random.key(0))

    @jax.jit
    def first_batch(parameters):
        window = gather_windows(model, rows, starts[:BATCH_SIZE], HORIZON)
        return open_loop_loss(model, parameters, *window, jnp.ones(N_JOINT))

    loss, gradient = jax.value_and_grad(first_batch)(parameters)
    optimiser = optax.adam(LEARNING_RATE)
    loss_of = prediction_loss(model, np.ones(N_JOINT))
    run = compile_epoch(model, optimiser, loss_of, HORIZON, BATCH_SIZE, N_BATCHES)
    state = optimiser.init(parameters)
    key = jax.random.key(1)
    serve(
        {"loss": float(loss), "gradient_norm": float(optax.global_norm(gradient)), "name": jax.__version__},
        rate_of(lambda: run(parameters, state, rows, starts, key), N_BATCHES),
    )


def serve_peak(case: dict, data_file: Path) -> None:
    import jax
    import jax.numpy as jnp

    matrix = jnp.asarray(np.random.default_rng(0).normal(size=(PEAK_SIZE, PEAK_SIZE)), jnp.float32)
    product = jax.jit(lambda a: a @ a)
    serve({}, rate_of(lambda: product(matrix), 2.0 * PEAK_SIZE**3))


def serve_rollouts(case: dict, data_file: Path) -> None:
    import jax
    import jax.numpy as jnp

    model = model_of(case)
    parameters = model.initialise(jax.random.key(0))
    random = np.random.default_rng(0)
    history = model.initial_history(
        jnp.asarray(random.uniform(case["lower"], case["upper"], (ROLLOUTS, N_JOINT)), jnp.float32)
    )
    commands = jnp.asarray(random.integers(-1, 2, (ROLLOUTS, ROLLOUT_STEPS, N_JOINT)), jnp.float32)
    predict = jax.jit(lambda parameters, history: model.roll_out(parameters, history, commands))
    serve({}, rate_of(lambda: predict(parameters, history), ROLLOUTS))


def serve_environment_steps(case: dict, data_file: Path) -> None:
    """`model.step` as the reaching environment calls it, with x̃ formed as its observation once per decision."""
    import jax
    import jax.numpy as jnp

    model = model_of(case)
    parameters = model.initialise(jax.random.key(0))
    random = np.random.default_rng(0)
    history = model.initial_history(
        jnp.asarray(random.uniform(case["lower"], case["upper"], (ENVIRONMENTS, N_JOINT)), jnp.float32)
    )
    command = jnp.asarray(random.integers(-1, 2, (ENVIRONMENTS, N_JOINT)), jnp.float32)

    @jax.jit
    def advance(parameters, history):
        return jax.lax.scan(
            lambda history, _: (model.step(parameters, history, command), None),
            history,
            length=ENVIRONMENT_STEPS,
        )[0]

    serve({}, rate_of(lambda: advance(parameters, history), ENVIRONMENTS * ENVIRONMENT_STEPS))


SERVERS = {
    "training": serve_training,
    "peak": serve_peak,
    "rollouts": serve_rollouts,
    "steps": serve_environment_steps,
}


class Turns:
    """A process that measures when asked."""

    def __init__(self, command: list[str]) -> None:
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.first = self._answer()
        self.rates: list[float] = []

    def take(self, repetitions: int) -> float:
        """The rate of one turn."""
        self._process.stdin.write(f"{repetitions}\n")
        self._process.stdin.flush()
        self.rates.append(self._answer()["per_second"])
        return self.rates[-1]

    def end(self) -> None:
        """Let the process end."""
        self._process.stdin.close()
        self._process.wait()

    def _answer(self) -> dict:
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"{self._process.args[0]} ended; its message stands above")
        return json.loads(line)


def ours(what: str, case: dict, data_file: Path) -> Turns:
    return Turns([sys.executable, __file__, "--serve", what, json.dumps(case), str(data_file)])


def pytorch(python: str, mode: str, case: dict, data_file: Path) -> Turns:
    script = Path(__file__).with_name("identification_speed_pytorch.py")
    return Turns([python, str(script), str(data_file), json.dumps(case), mode])


def take_turns(servers: dict[str, Turns], seconds: float, turn_seconds: float) -> None:
    """Round after round each server once, for `seconds` in all; each turn takes about `turn_seconds`."""
    repetitions = {}
    for name, server in servers.items():
        begin = time.perf_counter()
        server.take(1)
        repetitions[name] = max(1, round(turn_seconds / (time.perf_counter() - begin)))
        server.rates.clear()
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        for name, server in servers.items():
            server.take(repetitions[name])
    for server in servers.values():
        server.end()


def measure_training(name: str, arguments: argparse.Namespace, folder: Path) -> None:
    parameterization, hidden = (NETWORKS | KAN)[name]
    case, data_file = case_of(parameterization, hidden), folder / "data.npz"
    write_data(data_file, case)
    servers = {
        "peak": ours("peak", case, data_file),
        "this project": ours("training", case, data_file),
    }
    if arguments.torch_python and parameterization == "mlp":
        for mode in ("eager", "compiled"):
            servers[f"PyTorch {mode}"] = pytorch(arguments.torch_python, mode, case, data_file)
    expected = servers["this project"].first
    for server in servers.values():
        for figure in ("loss", "gradient_norm"):
            if figure in server.first and abs(server.first[figure] / expected[figure] - 1.0) > SAME:
                raise SystemExit(f"{figure}s differ: {[server.first for server in servers.values()]}")
    take_turns(servers, arguments.seconds, arguments.turn_seconds)
    peak = max(servers.pop("peak").rates)
    operations = training_operations(parameterization, hidden)
    print(f"\nTraining, {name}, lags {LAGS}, horizon {HORIZON}, batch {BATCH_SIZE}")
    print(
        f"  {operations / 1e9:.2f} GFLOP per step; peak {peak / 1e9:.0f} GFLOP/s, "
        f"so at most {peak / operations:.1f} steps/s"
    )
    print(f"  {'':24s} steps/s best  median  share of peak  this project / it: best  median")
    best = max(servers["this project"].rates)
    for label, server in servers.items():
        ratios = [a / b for a, b in zip(servers["this project"].rates, server.rates, strict=True)]
        print(
            f"  {label + ' ' + server.first['name']:24s} {max(server.rates):12.1f} "
            f"{statistics.median(server.rates):7.1f} {max(server.rates) * operations / peak:14.0%} "
            f"{best / max(server.rates):25.2f} {statistics.median(ratios):7.2f}"
        )


def measure_predictions(name: str, arguments: argparse.Namespace, folder: Path) -> None:
    case = case_of(*(NETWORKS | KAN | NFIR)[name])
    servers = {what: ours(what, case, folder / "none") for what in ("rollouts", "steps")}
    take_turns(servers, arguments.seconds / 2, arguments.turn_seconds)
    rollouts, steps = (servers[what].rates for what in ("rollouts", "steps"))
    print(
        f"  {name:14s} {max(rollouts):9.0f} {statistics.median(rollouts):9.0f} rollouts/s   "
        f"{max(steps):12.0f} {statistics.median(steps):12.0f} model.step/s"
    )


def measure_time_to_error(tuples: Path) -> None:
    """The default profile's training of the Δq̇ MLP, until L|eval is reached."""
    from pipeline.configuration.load import load_machine, load_section
    from pipeline.dynamics.model.dynamics_model import Target
    from pipeline.dynamics.model.network import Parameterization
    from pipeline.dynamics.settings import IdentifyConfig
    from pipeline.dynamics.training.fit import fit
    from pipeline.logs.tuples import read_tuples

    class Reached(Exception):
        pass

    begin, begin_processor = time.perf_counter(), time.process_time()

    def progress(epoch: int, training_loss: float, evaluation_loss: float) -> None:
        if epoch == 1:
            print(f"  after epoch 1: {time.perf_counter() - begin:.1f} s (compilation included)")
        if evaluation_loss <= EVALUATION_LOSS:
            raise Reached(epoch)

    machine = load_machine("bobcat_e10")
    identify = load_section("identify", IdentifyConfig, "default")
    kind = Parameterization.mlp, Target.dqdot
    print(f"\nDefault profile, mlp_dqdot, until L|eval <= {EVALUATION_LOSS}")
    try:
        fit(
            read_tuples(tuples, machine),
            machine,
            *kind,
            identify.selected["mlp_dqdot"],
            identify,
            0,
            progress,
        )
        print("  not reached")
    except Reached as reached:
        print(
            f"  reached in epoch {reached}, after {time.perf_counter() - begin:.1f} s, "
            f"{time.process_time() - begin_processor:.1f} s of processor time"
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--torch-python", help="a Python with PyTorch")
    parser.add_argument("--tuples", type=Path, help="folder of tuples")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument(
        "--processor-time", action="store_true", help="instead of wall time; with --threads 1"
    )
    parser.add_argument("--seconds", type=float, default=30.0, help="of measuring per network")
    parser.add_argument("--turn-seconds", type=float, default=0.5, help="of one process at a time")
    parser.add_argument(
        "--networks", nargs="*", default=[*NETWORKS, *KAN, *NFIR], choices=[*NETWORKS, *KAN, *NFIR]
    )
    parser.add_argument("--only", nargs="*", default=["training", "predictions"], help="or nothing")
    parser.add_argument("--serve", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        what, case, data_file = arguments.serve
        SERVERS[what](json.loads(case), Path(data_file))
        return
    if arguments.processor_time:
        os.environ["SPEED_CLOCK"] = "processor"
    # Inherited by all processes: both libraries take as many threads as there are processors.
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: arguments.threads])
    clock = "processor" if arguments.processor_time else "wall"
    print(f"{arguments.threads} processors, {clock} time; load before: {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        if "training" in arguments.only:
            for name in (name for name in arguments.networks if name not in NFIR):
                measure_training(name, arguments, Path(folder))
        if "predictions" in arguments.only:
            print(
                f"\nPrediction, best and median: {ROLLOUTS} rollouts of {ROLLOUT_STEPS} steps at a time; "
                f"model.step of {ENVIRONMENTS} environments"
            )
            for name in arguments.networks:
                measure_predictions(name, arguments, Path(folder))
    if arguments.tuples:
        measure_time_to_error(arguments.tuples)


if __name__ == "__main__":
    main()
