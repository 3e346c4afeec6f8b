"""A film of one evaluated episode."""

import tempfile
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pipeline.machine.kinematics import load_arm
from pipeline.machine.render import render_film, save_film
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.episodes import load_episodes
from pipeline.reaching.metrics import PATH_END_PRECISION
from pipeline.reporting.page import Figure

SECONDS_AFTER_REACHING = 2.0
MAXIMUM_SECONDS = 15.0
WIDTH, HEIGHT = 640, 480


def episode_film(
    machine: MachineSpecification,
    machine_directory: Path,
    evaluation: Path,
    episode: int,
    frames_per_second: int,
) -> Figure:
    """Render one episode up to a moment after it reached its target, in real time.

    Args:
        machine: The machine; it has a robot description.
        machine_directory: Where `conf/machine` lies.
        evaluation: Folder with `episodes.npz` and `traces.npz`.
        episode: Its number.
        frames_per_second: Of the film; a divisor of the machine's rate.

    Raises:
        RenderingUnavailableError: This computer cannot render.
    """
    target_q = load_episodes(evaluation / "episodes.npz").targets[episode]
    with np.load(evaluation / "traces.npz") as traces:
        q, position = traces["q"][episode], traces["position"][episode]
        reached = (traces["position_error"][episode] < PATH_END_PRECISION[0]) & (
            np.abs(traces["pitch_error"][episode]) < PATH_END_PRECISION[1]
        )
    end = int(np.argmax(reached)) if reached.any() else len(q)
    end = min(
        end + round(SECONDS_AFTER_REACHING * machine.rate_hz),
        round(MAXIMUM_SECONDS * machine.rate_hz),
        len(q),
    )
    frames = slice(0, end, max(round(machine.rate_hz / frames_per_second), 1))
    target = load_arm(machine, machine_directory).forward(jnp.asarray(target_q))
    pictures = render_film(
        machine,
        machine_directory,
        q[frames],
        [target] * len(q[frames]),
        position[frames],
        width=WIDTH,
        height=HEIGHT,
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "episode.webp"
        save_film(pictures, path, frames_per_second)
        content = path.read_bytes()
    outcome = (
        "reached within 0.02 m and 0.02 rad" if reached.any() else "not reached within 0.02 m and 0.02 rad"
    )
    caption = (
        f"Episode {episode}, in real time; the target pose (drawn beside the arm) was {outcome}. The "
        "translucent sector is the restricted workspace W+, the bars are the grill."
    )
    return Figure("An evaluated episode", caption, content, "image/webp")
