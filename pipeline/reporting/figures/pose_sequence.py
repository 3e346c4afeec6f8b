"""Moments of a drive to successive targets, side by side (paper, figure "Real-world ... policy execution")."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from PIL import Image

from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.columns import as_array
from pipeline.logs.messages.raw_log import NANOSECONDS, RawLog
from pipeline.machine.kinematics import Pose, load_arm
from pipeline.machine.orientation import yaw_pitch
from pipeline.machine.render import ArmRenderer
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.metrics import REPORTED_PRECISIONS
from pipeline.reporting.figures.film import labelled
from pipeline.reporting.page import PNG, Figure
from pipeline.reporting.results.controllers import controller_title
from pipeline.reporting.results.deployments import Deployment

MOMENTS = 4
WIDTH, HEIGHT = 400, 300  # pixels of a moment


class Way(NamedTuple):
    """The way to one target, from its arrival to where it is reached.

    Attributes:
        target: the pose.
        t_s: since the target came, s, (T,).
        q: rad (m), (T, n_joint).
        position: of the tip in {B}, m, (T, 3).
        position_error: m, (T,).
        pitch_error: absolute, rad, (T,).
    """

    target: Pose
    t_s: np.ndarray
    q: np.ndarray
    position: np.ndarray
    position_error: np.ndarray
    pitch_error: np.ndarray


def ways_to(machine: MachineSpecification, directory: Path, log: RawLog, n: int) -> list[Way]:
    """The ways to the first `n` targets of a log, in the order of time.

    Each ends at the first moment within the finest precision, of those that the tables report, that it attains; if it
    attains none, with the last moment before the next target.
    """
    if log.targets is None:
        return []
    arm, targets = load_arm(machine, directory), log.targets
    time_ns, q = as_array(log.joint_log_time_ns), as_array(log.q)
    begins = np.searchsorted(time_ns, np.sort(as_array(targets.log_time_ns)))
    poses = zip(as_array(targets.position), as_array(targets.quaternion), strict=True)
    ways: list[Way] = []
    for (position, quaternion), begin, end in zip(poses, begins, [*begins[1:], len(q)], strict=True):
        if end <= begin or len(ways) == n:
            continue
        tip, pitch = arm.forward(q[begin:end]).position, arm.pitch(q[begin:end])
        position_error = np.linalg.norm(tip - position, axis=1)
        turn = pitch - float(yaw_pitch(jnp.asarray(quaternion))[1])
        pitch_error = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
        within = [(position_error < m) & (pitch_error < rad) for m, rad in REPORTED_PRECISIONS]
        shown = next((1 + int(np.argmax(hits)) for hits in within if hits.any()), len(tip))
        t_s = (time_ns[begin:end] - time_ns[begin]) / NANOSECONDS
        columns = (t_s, q[begin:end], tip, position_error, pitch_error)
        ways.append(Way(Pose(position, quaternion), *(column[:shown] for column in columns)))
    return ways


def successive_targets(
    machine: MachineSpecification, machine_directory: Path, deployments: Sequence[Deployment]
) -> Figure | None:
    """Two successive targets on the plant, of a PPO policy as in the paper if there is one.

    Raises:
        RenderingUnavailableError: this computer cannot render.
    """
    for deployment in sorted(deployments, key=lambda deployment: not deployment.name.startswith("ppo")):
        entries = find_logs(deployment.plant_bags) if deployment.plant_bags is not None else []
        ways = ways_to(machine, machine_directory, read_log(entries[0], machine), 2) if entries else []
        if not ways:
            continue
        ends = " and ".join(
            f"{way.position_error[-1]:.3f} m and {way.pitch_error[-1]:.3f} rad after {way.t_s[-1]:.1f} s"
            for way in ways
        )
        return Figure(
            f"Successive targets on the plant: {controller_title(deployment.name)}",
            "A row per target, the first ones of the drive: the time since it came, and the distance and pitch error "
            "left. The green hammer is the target pose, the red line the way so far. Each row ends at the first moment "
            f"within the finest precision of the tables that is attained, here with {ends}.",
            sequence_picture(machine, machine_directory, ways),
            PNG,
        )
    return None


def sequence_picture(machine: MachineSpecification, directory: Path, ways: list[Way]) -> bytes:
    """Four moments of each way in a row, evenly spaced in time, the first and the last included; PNG.

    Raises:
        RenderingUnavailableError: This computer cannot render.
    """
    rows = []
    with ArmRenderer(machine, directory, WIDTH, HEIGHT) as renderer:
        for way in ways:
            moments = []
            for i in np.searchsorted(way.t_s, np.linspace(0.0, way.t_s[-1], MOMENTS)).tolist():
                picture = renderer.frame(way.q[i], way.target, trail=way.position[: i + 1])
                errors = f"{way.position_error[i]:.2f} m, {way.pitch_error[i]:.2f} rad"
                moments.append(labelled(picture, [f"{way.t_s[i]:.1f} s", errors]))
            rows.append(np.hstack(moments))
    buffer = io.BytesIO()
    Image.fromarray(np.vstack(rows)).save(buffer, format="png")
    return buffer.getvalue()
