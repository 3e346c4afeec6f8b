"""The report's chapter on the recordings used for training."""

from collections.abc import Sequence

import numpy as np

from pipeline.logs.tuples import Trajectory
from pipeline.machine.kinematics import Arm
from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.figures.clouds import cloud_of
from pipeline.reporting.figures.workspace import cloud_figure
from pipeline.reporting.page import PNG, Figure, Section
from pipeline.reporting.table import Table


def data_section(
    machine: MachineSpecification, arm: Arm | None, trajectories: Sequence[Trajectory]
) -> Section:
    """The recordings used for training, and their coverage of the workspace."""
    rows = [
        [
            trajectory.name,
            f"{len(trajectory) * machine.dt_s / 60:.1f}",
            str(len(trajectory)),
            f"{100 * np.mean(np.any(trajectory.a != 0, axis=1)):.0f} %",
        ]
        for trajectory in trajectories
    ]
    table = Table("Recordings to learn from", ["Recording", "Minutes", "Steps", "Steps with a command"], rows)
    figures = []
    if arm is not None and machine.workspace is not None:
        clouds = {trajectory.name: cloud_of(arm, trajectory.q) for trajectory in trajectories}
        figures.append(
            Figure(
                "End-effector positions while teleoperated",
                "Seen from above and from the side, coloured by pitch; outlined is the restricted workspace W+.",
                cloud_figure(clouds, machine.workspace),
                PNG,
            )
        )
    minutes = sum(len(trajectory) for trajectory in trajectories) * machine.dt_s / 60
    return Section(
        "What it learnt from",
        f"{len(trajectories)} recordings, {minutes:.0f} minutes of joint angles and commands; nothing "
        "else was measured.",
        figures,
        [table],
    )
