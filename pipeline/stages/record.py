"""Stage `record`: a scripted operator teleoperates the simulated machine; genuine bags are written."""

import shutil
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from omegaconf import MISSING

from pipeline.configuration import PipelineConfiguration, stage
from pipeline.logs.writer import write_bag
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.operator import draw_style
from pipeline.plant.session import RecordConfig, record_session
from pipeline.plant.simulated import simulated_machine
from pipeline.tracking import StageRun, progress_bar

NANOSECONDS = 1_000_000_000


@dataclass
class RecordStage(PipelineConfiguration):
    """Keys of `conf/record.yaml`."""

    record: RecordConfig = MISSING
    logs: str | None = None
    output: str = MISSING


@stage(RecordStage)
def main(configuration: RecordStage, run: StageRun) -> None:
    """Record the sessions to learn from and the held-out one, unless the user named logs of their own."""
    output, record = Path(configuration.output), configuration.record
    folders = {"sessions": record.session_minutes, "held_out": [record.held_out_minutes]}
    for folder in folders:
        shutil.rmtree(output / folder, ignore_errors=True)
        (output / folder).mkdir(parents=True)
    if configuration.logs is not None and Path(configuration.logs) != output / "sessions":
        print(
            f"record: the logs in {configuration.logs} take the place of recorded ones; nothing is recorded"
        )
        return
    start = datetime.fromisoformat(record.first_session)
    seeds = iter(
        np.random.SeedSequence(record.seed).generate_state(1 + sum(map(len, folders.values()))).tolist()
    )
    style_seed = next(seeds)
    for folder, durations in folders.items():
        for minutes in durations:
            name = start.strftime("%Y-%m-%d-%H-%M-%S")
            record_bag(output / folder / name, configuration.machine, style_seed, minutes, next(seeds), start)
            start += timedelta(days=1)
    run.metrics({"recorded_minutes": sum(record.session_minutes) + record.held_out_minutes})


def record_bag(
    path: Path, machine: MachineSpecification, style_seed: int, minutes: float, seed: int, start: datetime
) -> None:
    """Record one session of the simulated machine into a bag."""
    with progress_bar(f"record {path.name}", total=round(minutes * 60), unit="s") as bar:
        log = record_session(
            machine,
            simulated_machine(machine.name),
            draw_style(style_seed),
            minutes,
            seed,
            start_time_ns=int(start.timestamp()) * NANOSECONDS,
            progress=lambda time_s: bar.update(round(time_s) - bar.n),
        )
    write_bag(
        path,
        machine,
        joint_state_header_stamp_ns=log.joint_state_header_stamp_ns,
        joint_state_log_time_ns=log.joint_state_log_time_ns,
        joint_names=log.joint_names,
        positions=log.positions,
        command_log_time_ns=log.command_log_time_ns,
        commands=log.commands,
    )


if __name__ == "__main__":
    main()
