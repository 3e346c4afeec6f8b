"""The plain side of icem_speed.py: the published algorithm as one would write it, rollouts in NumPy or PyTorch.

Imports NumPy and, if asked to, PyTorch only, so that it runs in an environment of its own. Reads the case from a
file, then answers each line on standard input, a number of decisions, with one line of JSON.
"""

import json
import os
import sys
import time

import numpy as np


def coloured_noise(random, exponent, n, horizon, n_joint):
    """As the package `colorednoise` makes it: random Fourier components, transformed back."""
    wave = np.fft.rfftfreq(horizon)
    scale = np.maximum(wave, 1.0 / horizon) ** (-exponent / 2.0)
    size = (n, n_joint, len(wave))
    real, imaginary = random.normal(size=size) * scale, random.normal(size=size) * scale
    edges = [0, -1] if horizon % 2 == 0 else [0]
    imaginary[..., edges] = 0.0
    real[..., edges] *= np.sqrt(2.0)
    weights = np.where(np.isin(np.arange(len(wave)), np.array(edges) % len(wave)), 2.0, 4.0)
    deviation = np.sqrt((weights * scale**2).sum()) / horizon
    return (np.fft.irfft(real + 1j * imaginary, n=horizon) / deviation).transpose(0, 2, 1).astype(np.float32)


class Rollout:
    """Returns of command sequences (N, H, n_joint): the whole window is rolled, tick by tick."""

    def __init__(self, data, ops):
        self.ops = ops
        self.of = np.asarray if ops is np else ops.from_numpy
        self.s = json.loads(str(data["scalars"]))
        self.d = {k: self.of(np.array(v)) for k, v in data.items() if k != "scalars"}
        self.chain = [
            [tuple(map(float, row)) for row in data[k]] for k in ("body_position", "body_quaternion", "axis")
        ]
        self.tip = tuple(map(float, data["tip_position"])), tuple(map(float, data["tip_quaternion"]))
        self.layers = [(self.d[f"kernel_{i}"], self.d[f"bias_{i}"]) for i in range(3)]
        self.goal_pose = self.forward(self.d["goal"])

    def silu(self, x):
        """SiLU, of what the library offers."""
        return x / (1.0 + np.exp(-x)) if self.ops is np else self.ops.nn.functional.silu(x)

    def norm(self, x):
        """Euclidean norm over the last axis."""
        return self.ops.sqrt((x**2).sum(-1))

    def forward(self, q):
        """Tip position (..., 3) and quaternion (..., 4)."""
        ops, one = self.ops, q[..., 0] * 0.0
        position, rotation = (one, one, one), (one + 1.0, one, one, one)
        for joint, (offset, turn, axis) in enumerate(zip(*self.chain, strict=True)):
            position = add(position, rotate(rotation, offset))
            half = 0.5 * q[..., joint]
            sine = ops.sin(half)
            rotation = multiply(multiply(rotation, turn), (ops.cos(half), *(sine * a for a in axis)))
        position = add(position, rotate(rotation, self.tip[0]))
        return ops.stack(position, -1), ops.stack(multiply(rotation, self.tip[1]), -1)

    def reward(self, q, command, previous):
        """The full reward of ticks that reached q (N, n_joint)."""
        ops, r, w, d = self.ops, self.s["reward"], self.s["workspace"], self.d
        position, rotation = self.forward(q)
        goal_position, goal_rotation = self.goal_pose
        distance = self.norm(position - goal_position)
        apart, together = self.norm(rotation - goal_rotation), self.norm(rotation + goal_rotation)
        angle = 4.0 / np.pi * ops.arctan2(ops.minimum(apart, together), ops.maximum(apart, together))
        error = q - d["goal"]
        yaw, pitch = error[..., 0], error[..., 1] + error[..., 2] + error[..., 3]
        coarse = (distance < r["position_threshold_m"]) & (angle < r["rotation_threshold"])
        fine = (distance < r["fine_position_threshold_m"]) & (angle < r["fine_rotation_threshold"])
        angles = (yaw**2 < r["angle_threshold_rad2"]) & (pitch**2 < r["angle_threshold_rad2"])
        near = (error**2 < r["configuration_threshold_rad2"]).all(-1)
        x, y, z = position[..., 0], position[..., 1], position[..., 2]
        radius = ops.sqrt(x**2 + y**2)
        inside = (
            (radius >= w["radius_min_m"])
            & (radius <= w["radius_max_m"])
            & (abs(q[..., 0]) <= w["yaw_max_rad"])
            & (x * ops.cos(q[..., 0]) + y * ops.sin(q[..., 0]) > 0.0)
            & (z >= w["z_min_m"])
            & (z <= w["z_max_m"])
        )
        return (
            -r["position_weight"] * distance
            - r["rotation_weight"] * angle
            - r["configuration_weight"] * self.norm(error)
            + r["pose_bonus"] * (1.0 * coarse + 1.0 * fine)
            + r["angle_bonus"] * angles
            + r["configuration_bonus"] * near
            - r["action_weight"] * abs(command - previous).mean(-1)
            - r["workspace_weight"] * ~inside
        )

    def returns(self, sequences):
        """Discounted sums of rewards, (N,)."""
        ops, d, n = self.ops, self.d, len(sequences)
        sequences = self.of(sequences)
        motion, commands, q, previous = (
            ops.broadcast_to(d[k], (n, *d[k].shape)) for k in ("motion", "commands", "q", "previous")
        )
        total = 0.0
        for entry in range(sequences.shape[1]):
            command = sequences[:, entry]
            for _ in range(self.s["held_ticks"]):
                commands = ops.concatenate([commands[:, 1:], command[:, None]], 1)
                x = ops.concatenate(
                    [
                        (motion / d["velocity_limit"]).reshape(n, -1),
                        commands.reshape(n, -1),
                        2.0 * (q - d["lower"]) / (d["upper"] - d["lower"]) - 1.0,
                    ],
                    1,
                )
                for kernel, bias in self.layers[:-1]:
                    x = self.silu(x @ kernel + bias)
                velocity = motion[:, -1] + d["residual_scale"] * (x @ self.layers[-1][0] + self.layers[-1][1])
                moved = q + self.s["dt_s"] * velocity
                q = ops.minimum(ops.maximum(moved, d["lower"]), d["upper"])
                velocity = ops.where(q == moved, velocity, 0.0 * velocity)
                motion = ops.concatenate([motion[:, 1:], velocity[:, None]], 1)
                total = total + self.s["icem"]["discount"] ** entry * self.reward(q, command, previous)
                previous = command
        return np.asarray(total)


def add(a, b):
    return tuple(x + y for x, y in zip(a, b, strict=True))


def multiply(a, b):
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def rotate(r, v):
    return multiply(multiply(r, (0.0, *v)), (r[0], -r[1], -r[2], -r[3]))[1:]


class Planner:
    """iCEM (Pinneri et al. 2021, Algorithm 1)."""

    def __init__(self, c, shift, returns):
        self.c, self.shift, self.returns = c, shift, returns
        self.random = np.random.default_rng(0)
        self.mean = np.zeros((c["horizon"], 4), np.float32)
        self.elites = None

    def sample(self, n, mean, std):
        """Clipped sequences, (n, H, n_joint)."""
        c = self.c
        noise = coloured_noise(self.random, c["noise_exponent"], n, c["horizon"], 4)
        return np.clip(mean + std * noise, -1.0, 1.0).astype(np.float32)

    def decide(self):
        """Plan once; returns the first proto-action of the best sequence."""
        c, mean = self.c, self.mean
        std = np.full_like(mean, c["initial_std"])
        n_reused = int(c["elite_fraction"] * c["elites"])
        elites, values = self.elites, None
        for i in range(c["iterations"]):
            n = min(c["samples"], max(int(c["samples"] / c["sample_decay"] ** i), 2 * c["elites"]))
            sequences = self.sample(n, mean, std)
            if i == c["iterations"] - 1:
                sequences[0] = mean
            if i == 0 and elites is not None:
                last = self.sample(n_reused, mean, std)[:, -self.shift :]
                moved = np.concatenate([elites[:n_reused, self.shift :], last], axis=1)
                sequences = np.concatenate([sequences, moved])
            found = self.returns(
                np.where(np.abs(sequences) > 0.5, np.sign(sequences), 0.0).astype(np.float32)
            )
            if i > 0:
                sequences = np.concatenate([sequences, elites[:n_reused]])
                found = np.concatenate([found, values[:n_reused]])
            best = np.argsort(-found)[: c["elites"]]
            elites, values = sequences[best], found[best]
            mean = c["momentum"] * mean + (1 - c["momentum"]) * elites.mean(axis=0)
            std = c["momentum"] * std + (1 - c["momentum"]) * elites.std(axis=0)
        self.mean = np.concatenate([mean[self.shift :], np.repeat(mean[-1:], self.shift, axis=0)])
        self.elites = elites
        return elites[0, 0]


def main() -> None:
    case_file, library = sys.argv[1:]
    with np.load(case_file) as content:
        data = dict(content)
    ops = np
    if library == "torch":
        import torch

        torch.set_num_threads(len(os.sched_getaffinity(0)))
        torch.set_grad_enabled(False)
        ops = torch
    rollout = Rollout(data, ops)
    planner = Planner(rollout.s["icem"], rollout.s["shift"], rollout.returns)
    planner.decide()  # from now on there are elites
    name = f"{library} {ops.__version__}"
    print(json.dumps({"returns": rollout.returns(data["checked"]).tolist(), "name": name}), flush=True)
    clock = time.process_time if os.environ.get("SPEED_CLOCK") == "processor" else time.perf_counter
    for line in sys.stdin:
        begin = clock()
        for _ in range(int(line)):
            planner.decide()
        print(json.dumps({"per_second": int(line) / (clock() - begin)}), flush=True)


if __name__ == "__main__":
    main()
