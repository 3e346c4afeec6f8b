"""A film of one evaluated episode: the moving arm above, errors and commands below."""

import tempfile
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from matplotlib.font_manager import findfont
from PIL import Image, ImageDraw, ImageFont

from pipeline.machine.kinematics import load_arm
from pipeline.machine.render import render_film, save_film
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.metrics import PATH_END_PRECISION, Traces, success
from pipeline.reporting.figures.episode_chart import EpisodeChart, EpisodeCourse

SECONDS_AFTER_REACHING = 2.0
MAXIMUM_SECONDS = 10.0
WIDTH, RENDERED_HEIGHT, CHART_HEIGHT = 640, 400, 240
FONT_SIZE, MARGIN = 15, 10  # pixels
INK, PAPER = (27, 39, 51), (255, 255, 255, 205)


class Film(NamedTuple):
    """Pictures of an episode, and its outcome in words.

    Attributes:
        pictures: uint8, shape (height, width, 3) each.
        outcome: time of reaching the target, or the smallest distance.
    """

    pictures: list[np.ndarray]
    outcome: str


def episode_film(
    machine: MachineSpecification,
    machine_directory: Path,
    title: str,
    traces: Traces,
    episodes: Episodes,
    episode: int,
    frames_per_second: int,
) -> Film:
    """Render one episode up to a moment after it reached its target, in real time.

    Args:
        machine: The machine; it has a robot description.
        machine_directory: Where `conf/machine` lies.
        title: Text on every picture.
        traces: Traces of an evaluation.
        episodes: Starts and targets of the evaluation.
        episode: Number of the episode.
        frames_per_second: Frame rate; a divisor of the machine's rate.

    Raises:
        RenderingUnavailableError: This computer cannot render.
    """
    reached = success(traces, *PATH_END_PRECISION)[episode]
    n_ticks = shown_ticks(reached, machine.rate_hz)
    course = EpisodeCourse(
        (1.0 + np.arange(n_ticks)) * machine.dt_s,
        traces.position_error[episode, :n_ticks],
        traces.pitch_error[episode, :n_ticks],
        traces.command[episode, :n_ticks],
    )
    frames = np.arange(0, n_ticks, max(round(machine.rate_hz / frames_per_second), 1))
    target = load_arm(machine, machine_directory).forward(jnp.asarray(episodes.targets[episode]))
    rendered = render_film(
        machine,
        machine_directory,
        traces.q[episode, frames],
        [target] * len(frames),
        traces.position[episode, frames],
        width=WIDTH,
        height=RENDERED_HEIGHT,
    )
    chart = EpisodeChart(course, machine.joint_names, WIDTH, CHART_HEIGHT)
    first = int(np.argmax(reached)) if reached.any() else None
    pictures = []
    for frame, picture in zip(frames.tolist(), rendered, strict=True):
        lines = [f"{title}, {course.t_s[frame]:.1f} s", _state(course, frame)]
        if first is not None and frame >= first:
            lines.append(f"reached after {course.t_s[first]:.1f} s")
        pictures.append(np.vstack([labelled(picture, lines), chart.at(course.t_s[frame])]))
    return Film(pictures, outcome(traces, episode, machine.dt_s))


def shown_ticks(reached: np.ndarray, rate_hz: float) -> int:
    """Number of displayed ticks of an episode; `reached` is boolean per tick, shape (T,)."""
    longest = min(round(MAXIMUM_SECONDS * rate_hz), len(reached))
    if not reached.any():
        return longest
    return min(int(np.argmax(reached)) + 1 + round(SECONDS_AFTER_REACHING * rate_hz), longest)


def outcome(traces: Traces, episode: int, dt_s: float) -> str:
    """Time of reaching the target, or the smallest distance, for a caption."""
    position, pitch = PATH_END_PRECISION
    reached = success(traces, position, pitch)[episode]
    within = f"within {position:g} m and {pitch:g} rad"
    if reached.any():
        return f"reached {within} after {(1 + int(np.argmax(reached))) * dt_s:.1f} s"
    nearest = int(np.argmin(traces.position_error[episode]))
    return (
        f"not reached {within} in {len(reached) * dt_s:.0f} s; nearest were "
        f"{traces.position_error[episode, nearest]:.3f} m, at {abs(traces.pitch_error[episode, nearest]):.3f} rad"
    )


def film_bytes(film: Film, frames_per_second: int) -> bytes:
    """The film as WebP."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.webp"
        save_film(film.pictures, path, frames_per_second)
        return path.read_bytes()


def _state(course: EpisodeCourse, frame: int) -> str:
    distance, pitch = course.position_error[frame], abs(course.pitch_error[frame])
    return f"{distance:.3f} m and {pitch:.3f} rad from the target"


def labelled(picture: np.ndarray, lines: list[str]) -> np.ndarray:
    """The picture with lines of text at its upper left."""
    image = Image.fromarray(picture).convert("RGBA")
    font = ImageFont.truetype(findfont("DejaVu Sans"), FONT_SIZE)
    layer = Image.new("RGBA", image.size)
    draw = ImageDraw.Draw(layer)
    text = "\n".join(lines)
    left, top, right, bottom = draw.multiline_textbbox((MARGIN, MARGIN), text, font=font)
    half = MARGIN / 2
    draw.rounded_rectangle((left - half, top - half, right + half, bottom + half), half, fill=PAPER)
    draw.multiline_text((MARGIN, MARGIN), text, font=font, fill=INK)
    return np.asarray(Image.alpha_composite(image, layer).convert("RGB"))
