"""How many times real time the simulated machine runs on one core.

    python -m benchmarks.plant_speed

Prints simulated time over processor time of this process: for one long command sequence (`run`), for control
periods one by one (`step`), and for a whole session with its operator.
"""

import time

import numpy as np

from pipeline.configuration.load import load_machine
from pipeline.plant.machines.bobcat_e10 import bobcat_e10
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import record_session
from pipeline.plant.simulator import Plant

START = np.array([0.0, 0.75, -1.4, -0.9])


def main() -> None:
    parameters, machine = bobcat_e10(), load_machine("bobcat_e10")
    commands = np.repeat(np.random.default_rng(0).integers(-1, 2, (1200, 4)), 10, axis=0)
    plant = Plant(parameters, 0, START)

    begin = time.process_time()
    plant.run(commands[:1])
    print(f"compilation: {time.process_time() - begin:.1f} s")

    begin = time.process_time()
    plant.run(commands)
    print(f"run:     {machine.dt_s * len(commands) / (time.process_time() - begin):6.0f} times real time")

    begin = time.process_time()
    for command in commands[:4000]:
        plant.step(command)
    print(f"step:    {machine.dt_s * 4000 / (time.process_time() - begin):6.0f} times real time")

    begin = time.process_time()
    record_session(machine, parameters, draw_style(0), 5.0, 0, 0)
    print(f"session: {300.0 / (time.process_time() - begin):6.0f} times real time")


if __name__ == "__main__":
    main()
