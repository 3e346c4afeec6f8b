"""Whether a policy's C file and its ONNX decide as the library does, over rollouts, and how long a decision takes.

    python -m benchmarks.exported_policy --model DIR --policy DIR [--decisions 1000000] [--machine NAME]

Episodes run on the model in closed loop: the loop tracker (float64) estimates velocities from positions, buffers hold
the window, and the policy decides every few ticks, as in the deployed graph, all episodes of a batch at once. Their
positions then go through the compiled C file, their observations through onnxruntime, one at a time. A command that
differs counts as a fault unless a discrete proto-action is within 1e-5 of its threshold; of continuous commands it is
one if it differs by more than 1e-5. Times are of the one processor that a decision uses: in C the whole tick, with
tracker, window and kinematics; in onnxruntime the call from Python. Exit status 1: a fault, or a 99th percentile of the
C file above 50 µs. Needs `cc`, and for ONNX the package onnxruntime.
"""

import argparse
import ctypes
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration, load_machine, load_section
from pipeline.deployment.components.controllers import ControllerState, measured
from pipeline.deployment.export.c_file import policy_as_c
from pipeline.deployment.export.exported import ExportedPolicy, exported_policy
from pipeline.deployment.export.onnx_file import COMMAND, OBSERVATION, PROTO_ACTION, policy_as_onnx
from pipeline.dynamics.model.specification import Target
from pipeline.logs.loop_tracker import advance, initial_state
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import CommandKind
from pipeline.reaching.discretise import PROTO_ACTION_THRESHOLD
from pipeline.reaching.episodes import Episodes, EpisodesConfig, evaluation_episodes
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.settings import ReachingSettings

BAND = 1e-5  # of proto-actions about their threshold
LONGEST_US = 50.0
BATCH = 400  # episodes

HARNESS = """
#include "policy.c"
#include <time.h>

/* One episode: positions (ticks, n), commands in force before each tick; out: proto-actions, commands and times. */
int run_episode(int n_ticks, const float *q, const float *target, const policy_command *before,
                float *proto_action, policy_command *command, double *microseconds)
{
    policy_state state;
    int tick, j, fault = 0;
    policy_init(&state);
    for (tick = 0; tick < n_ticks; tick++) {
        struct timespec begin, end;
        for (j = 0; j < POLICY_N_JOINT; j++)
            command[j] = before[j];
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begin);
        fault |= policy_step(&state, q, target, command);
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
        if (tick % POLICY_DECISION_TICKS == 0) {
            policy_command again[POLICY_N_JOINT];
            fault |= policy_decide(&state, target, proto_action, again);
            *microseconds++ = (double)(end.tv_sec - begin.tv_sec) * 1e6 + (double)(end.tv_nsec - begin.tv_nsec) * 1e-3;
            proto_action += POLICY_N_JOINT;
            command += POLICY_N_JOINT;
        }
        q += POLICY_N_JOINT;
        before += POLICY_N_JOINT;
    }
    return fault;
}
int state_bytes(void) { return (int)sizeof(policy_state); }
"""


class Decided(NamedTuple):
    """Decisions one after another: proto-actions and commands (n, n_joint), and the time of each, µs (n,)."""

    proto_action: np.ndarray
    command: np.ndarray
    microseconds: np.ndarray


class CompiledPolicy:
    """A policy's C file, compiled and loaded."""

    def __init__(self, source: str, exported: ExportedPolicy, folder: Path, *options: str) -> None:
        """Compile in `folder`; `options` are more of the compiler's."""
        (folder / "policy.c").write_text(source)
        (folder / "harness.c").write_text("#define _POSIX_C_SOURCE 199309L\n" + HARNESS)
        library = folder / "policy.so"
        command = ["cc", "-std=c99", "-O2", "-fPIC", "-shared", *options, str(folder / "harness.c")]
        subprocess.run([*command, "-o", str(library), "-lm"], check=True)
        self.functions = ctypes.CDLL(str(library))
        is_discrete = exported.task.machine.command_kind is CommandKind.discrete
        self._command_type = np.int8 if is_discrete else np.float32
        self._action_repeats = exported.action_repeats

    def run_episode(self, q: np.ndarray, target: np.ndarray, commands: np.ndarray) -> tuple[bool, Decided]:
        """Decide along positions.

        Args:
            q: (n_ticks, n_joint), rad (m).
            target: (n_joint,).
            commands: in force before each tick, (n_ticks, n_joint).

        Returns:
            Whether a call reported a fault, and the decisions.
        """
        n_ticks, n_joint = q.shape
        n = -(-n_ticks // self._action_repeats)
        given = [np.ascontiguousarray(q, np.float32), np.ascontiguousarray(target, np.float32)]
        given.append(np.ascontiguousarray(commands, self._command_type))
        decided = Decided(
            np.empty((n, n_joint), np.float32), np.empty((n + 1, n_joint), self._command_type), np.empty(n)
        )
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (*given, *decided)]
        fault = self.functions.run_episode(n_ticks, *pointers)
        return bool(fault), decided._replace(
            command=decided.command[:-1]
        )  # the last row is the harness's own


@dataclass
class Comparison:
    """Counts over all decisions of one copy of the policy."""

    is_discrete: bool
    n_proto_actions: int = 0
    n_near: int = 0
    n_near_different: int = 0
    n_faults: int = 0
    largest_difference: float = 0.0

    def add(self, library: Decided, copy: Decided) -> None:
        """Compare decisions on the same observations."""
        difference = np.abs(copy.proto_action - library.proto_action)
        apart = np.abs(copy.command - library.command)
        if self.is_discrete:
            near = np.abs(np.abs(library.proto_action) - PROTO_ACTION_THRESHOLD) <= BAND
            different = apart > 0
        else:
            near, different = np.zeros(apart.shape, bool), ~(apart <= BAND)
        self.n_proto_actions += apart.size
        self.n_near += int(near.sum())
        self.n_near_different += int((near & different).sum())
        self.n_faults += int((~near & different).sum())
        self.largest_difference = max(self.largest_difference, float(difference.max()))


class Batch(NamedTuple):
    """Episodes as the library ran them.

    Attributes:
        q: (n_episodes, n_ticks, n_joint).
        before: commands in force before each tick, the same shape.
        observations: (n_episodes, n_decisions, n_observation).
        proto_action: (n_episodes, n_decisions, n_joint).
        command: the same shape.
    """

    q: np.ndarray
    before: np.ndarray
    observations: np.ndarray
    proto_action: np.ndarray
    command: np.ndarray


class LibraryRun:
    """The library's own chain from positions to commands, over a batch of episodes."""

    def __init__(self, exported: ExportedPolicy, n_decisions: int) -> None:
        self._exported, self._n_decisions = exported, n_decisions
        task, policy = exported.task, exported.policy

        def decide(state: ControllerState) -> tuple[jax.Array, jax.Array, jax.Array]:
            observation = task.observe(measured(task, state))
            proto_action = policy.act(observation)
            return observation, proto_action, task.command(proto_action)

        self._decide = jax.jit(jax.vmap(decide))
        self._hold = jax.jit(
            lambda history, command: task.dynamics.hold(
                task.parameters, history, command, exported.action_repeats, task.stops
            )
        )

    def run(self, episodes: Episodes) -> Batch:
        """Run the episodes."""
        task = self._exported.task
        specification = task.dynamics.specification
        n, n_joint = episodes.starts.shape
        shape = (n, specification.lags + 1, n_joint)
        motion = np.zeros(shape, np.float32)
        if specification.target is Target.dq:
            motion[:] = episodes.starts[:, None]
        commands, command = np.zeros(shape, np.float32), np.zeros((n, n_joint), np.float32)
        tracker, history = initial_state(episodes.starts), task.dynamics.initial_history(episodes.starts)
        ticks, decisions, q = [], [], episodes.starts[None]
        for _ in range(self._n_decisions):
            for position in q:  # those since the last decision
                if ticks:
                    tracker, _ = advance(tracker, position, specification.dt_s, self._exported.loop_tracker)
                newest = position if specification.target is Target.dq else tracker.integral
                motion = np.concatenate([motion[:, 1:], newest[:, None].astype(np.float32)], axis=1)
                commands = np.concatenate([commands[:, 1:], command[:, None]], axis=1)
                ticks.append((position, command))
            decided = self._decide(ControllerState(motion, commands, position, episodes.targets))
            decisions.append(jax.device_get(decided))
            command = decisions[-1][-1]
            history, q = jax.device_get(self._hold(history, command))
        columns = [*zip(*ticks, strict=True), *zip(*decisions, strict=True)]
        return Batch(*(np.stack(column, axis=1) for column in columns))


def batches(
    exported: ExportedPolicy, episodes: Episodes, n_decisions: int
) -> Iterator[tuple[Episodes, Batch]]:
    run = LibraryRun(exported, n_decisions)
    for at in range(0, len(episodes.starts), BATCH):
        batch = Episodes(*(of[at : at + BATCH] for of in episodes))
        yield batch, run.run(batch)


def onnx_session(content: bytes) -> "onnxruntime.InferenceSession | None":  # type: ignore[name-defined] # noqa: F821
    try:
        import onnxruntime
    except ImportError:
        return None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def decide_by_onnx(session: "onnxruntime.InferenceSession", observations: np.ndarray) -> Decided:  # type: ignore[name-defined] # noqa: F821
    """Decide on observations (n, n_observation), one after another."""
    rows = []
    for observation in observations[:, None]:
        begin = time.thread_time_ns()
        proto_action, command = session.run([PROTO_ACTION, COMMAND], {OBSERVATION: observation})
        rows.append((proto_action[0], command[0], (time.thread_time_ns() - begin) * 1e-3))
    return Decided(*map(np.array, zip(*rows, strict=True)))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--policy", type=Path, required=True)
    parser.add_argument("--decisions", type=int, default=1_000_000)
    parser.add_argument("--machine", default="bobcat_e10")
    parser.add_argument("--profile", default="default")
    arguments = parser.parse_args()
    if shutil.which("cc") is None:
        sys.exit("exported_policy: no C compiler `cc`; install one")

    machine = load_machine(arguments.machine)
    control = load_section("control", ControlConfiguration, arguments.profile)
    conditions = load_section("episodes", EpisodesConfig, arguments.profile)
    reward = load_section("reward", RewardConfig, arguments.profile)
    arm = load_arm(machine, MACHINE_DIRECTORY)
    reaching = ReachingSettings(machine, arm, reward, conditions, control.action_repeats)
    exported = exported_policy(arguments.model, arguments.policy, reaching, control.loop_tracker)
    is_discrete = machine.command_kind is CommandKind.discrete
    session = onnx_session(policy_as_onnx(exported))
    if session is None:
        print("exported_policy: without onnxruntime; `make env` installs it")

    n_per_episode = conditions.steps // control.action_repeats
    n_episodes = -(-arguments.decisions // n_per_episode)
    episodes = evaluation_episodes(machine, arm, conditions, conditions.curve_seed, n_episodes)
    c_file, onnx_file = Comparison(is_discrete), Comparison(is_discrete)
    c_times, onnx_times, n_done, has_fault = [], [], 0, False
    with tempfile.TemporaryDirectory() as folder:
        compiled = CompiledPolicy(policy_as_c(exported), exported, Path(folder))
        if compiled.functions.policy_self_test():
            sys.exit("exported_policy: the C file's self-test failed")
        for of, batch in batches(exported, episodes, n_per_episode):
            for episode in range(len(of.starts)):
                library = Decided(batch.proto_action[episode], batch.command[episode], np.empty(0))
                fault, decided = compiled.run_episode(
                    batch.q[episode], of.targets[episode], batch.before[episode]
                )
                has_fault |= fault
                c_file.add(library, decided)
                c_times.append(decided.microseconds)
                if session is not None:
                    decided = decide_by_onnx(session, batch.observations[episode])
                    onnx_file.add(library, decided)
                    onnx_times.append(decided.microseconds)
            n_done += len(of.starts) * n_per_episode
            print(f"{n_done} decisions", file=sys.stderr, flush=True)

    print("| copy | decisions | proto-actions | within 1e-5 of a threshold | of these different | others different "
          "| largest difference of proto-actions | µs: median | 99th percentile | longest |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name, comparison, times in (("C", c_file, c_times), ("ONNX", onnx_file, onnx_times)):
        if times:
            middle, high, longest = np.quantile(np.concatenate(times), [0.5, 0.99, 1.0])
            print(
                f"| {name} | {n_done} | {comparison.n_proto_actions} | {comparison.n_near} "
                f"| {comparison.n_near_different} | {comparison.n_faults} | {comparison.largest_difference:.1e} "
                f"| {middle:.1f} | {high:.1f} | {longest:.0f} |"
            )
    is_slow = np.quantile(np.concatenate(c_times), 0.99) > LONGEST_US
    sys.exit(int(has_fault or is_slow or c_file.n_faults + onnx_file.n_faults > 0))


if __name__ == "__main__":
    main()
