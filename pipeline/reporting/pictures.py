"""Pictures of the evaluated controllers: films, paths, success rates, learning curves; saved, and loaded again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.machine.kinematics import Arm, load_arm
from pipeline.machine.offscreen import RenderingUnavailableError
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import workspace_of
from pipeline.reaching.episodes import load_episodes
from pipeline.reaching.metrics import PITCH_THRESHOLDS_RAD, POSITION_THRESHOLDS_M, load_traces
from pipeline.reporting.chapters.deployment import POSE_SEQUENCE, deployment_figures
from pipeline.reporting.figures.arrays import (
    CurvePanel,
    SeedCurves,
    learning_curve_figure,
    success_rate_figure,
)
from pipeline.reporting.figures.clouds import cloud_of
from pipeline.reporting.figures.film import episode_film, film_bytes
from pipeline.reporting.figures.paths import path_figure, paths_of
from pipeline.reporting.figures.pose_sequence import successive_targets
from pipeline.reporting.figures.workspace import cloud_figure
from pipeline.reporting.page import PNG, SVG, WEBP, Figure
from pipeline.reporting.results.controllers import ControllerResult, by_controller
from pipeline.reporting.results.deployments import Deployment
from pipeline.reporting.results.files import read_json, require_file
from pipeline.reporting.tables.counts import counts_text, seeds_text

SUFFIXES = {PNG: ".png", SVG: ".svg", WEBP: ".webp"}
CURVES = {  # metric to label and limits of the vertical axis
    "average_return": ("average return", None),
    "sr_004_004": ("success rate (0.04 m, 0.04 rad)", (0.0, 1.0)),
}
INDEX = "pictures.json"


@dataclass(frozen=True)
class Pictures:
    """Pictures of the controllers.

    Attributes:
        films: by controller.
        unavailable: why there are no films, or None.
        figures: by name.
    """

    films: dict[str, Figure]
    unavailable: str | None
    figures: dict[str, Figure]


@dataclass(frozen=True)
class PictureSettings:
    """What pictures show.

    Attributes:
        episode: Number of the episode that the films show.
        paths: Number of episodes, from the first on, whose paths are drawn.
        frames_per_second: Frame rate of the films; a divisor of the machine's rate.
    """

    episode: int
    paths: int
    frames_per_second: int

    def check(self, rate_hz: float) -> None:
        """Raise `InputError` where a number is out of its range, or no divisor of the machine's rate."""
        if self.episode < 0 or self.paths < 1:
            raise InputError(
                f"episode is {self.episode}, paths {self.paths}; they count from 0 and 1 upwards"
            )
        if self.frames_per_second < 1 or rate_hz % self.frames_per_second:
            raise InputError(
                f"frames_per_second is {self.frames_per_second}; it must divide the machine's {rate_hz:g} Hz"
            )


def draw_pictures(
    machine: MachineSpecification,
    machine_directory: Path,
    controllers: Sequence[ControllerResult],
    settings: PictureSettings,
    deployments: Sequence[Deployment] = (),
) -> Pictures:
    """Draw all pictures; films and paths are of each controller's first seed.

    Args:
        machine: the machine; it has a robot description.
        machine_directory: where `conf/machine` lies.
        controllers: evaluated controllers.
        settings: what the pictures show.
        deployments: results of the controllers in the graph and on the plant.

    Raises:
        InputError: See `PictureSettings.check`.
    """
    settings.check(machine.rate_hz)
    if not controllers:
        return Pictures({}, None, {})
    groups = by_controller(controllers)
    arm = load_arm(machine, machine_directory)
    figures = {
        "success_rates": success_rates(groups),
        "paths": paths(machine, arm, groups, settings.paths),
        "sampled_poses": sampled_poses(machine, arm, controllers),
    }
    if any(controller.curve for controller in controllers):
        figures["learning_curves"] = learning_curves(groups)
    figures |= deployment_figures(deployments)
    try:
        sequence = successive_targets(machine, machine_directory, deployments)
        figures |= {} if sequence is None else {POSE_SEQUENCE: sequence}
        films = {
            name: film(machine, machine_directory, group[0], settings.episode, settings.frames_per_second)
            for name, group in groups.items()
        }
    except RenderingUnavailableError as error:
        return Pictures({}, str(error), figures)
    return Pictures(films, None, figures)


def success_rates(groups: Mapping[str, Sequence[ControllerResult]]) -> Figure:
    """Success-rate matrices over the paper's grid of thresholds, mean over seeds."""
    rates = {
        f"{group[0].title} ({seeds_text(group)})": np.mean([c.success_rates for c in group], axis=0)
        for group in groups.values()
    }
    counts = "; ".join(counts_text(group[0].title, group) for group in groups.values())
    return Figure(
        "Success rates",
        "Percentage of the evaluation episodes in which distance and pitch error were below their thresholds at the "
        f"same tick, mean over seeds. {counts}.",
        success_rate_figure(rates, np.array(POSITION_THRESHOLDS_M), np.array(PITCH_THRESHOLDS_RAD)),
        SVG,
    )


def learning_curves(groups: Mapping[str, Sequence[ControllerResult]]) -> Figure:
    """Return and success rate over training, band over seeds."""
    trained = [group for group in groups.values() if group[0].curve]
    panels = [
        CurvePanel(label, limits, {group[0].title: learning_curve(group, metric) for group in trained})
        for metric, (label, limits) in CURVES.items()
    ]
    n_episodes = int(trained[0][0].curve[0]["n_episodes"])
    return Figure(
        "Learning curves",
        f"Over {n_episodes} fixed episodes that the evaluation does not use. Mean over seeds, band of one standard "
        "deviation, each seed as a thin line.",
        learning_curve_figure(panels),
        SVG,
    )


def learning_curve(group: Sequence[ControllerResult], metric: str) -> SeedCurves:
    """A metric over the steps that the curves of all seeds share."""
    by_seed = [{point["steps"]: point[metric] for point in controller.curve} for controller in group]
    steps = [step for step in by_seed[0] if all(step in points for points in by_seed)]
    return SeedCurves(np.array(steps), np.array([[points[step] for step in steps] for points in by_seed]))


def paths(
    machine: MachineSpecification, arm: Arm, groups: Mapping[str, Sequence[ControllerResult]], n_paths: int
) -> Figure:
    """Paths of the end effector in the first episodes."""
    ways = {}
    for group in groups.values():
        episodes = load_episodes(group[0].evaluation / "episodes.npz").first(n_paths)
        targets = np.asarray(arm.forward(jnp.asarray(episodes.targets)).position)
        ways[group[0].title] = paths_of(load_traces(group[0].evaluation / "traces.npz"), targets)
    return Figure(
        "End-effector paths",
        f"The first {n_paths} evaluation episodes of each controller's first seed, from above and from the side, up to "
        "the tick that reached the target within 0.02 m and 0.02 rad, or to the end. Outlined is the restricted "
        "workspace W+.",
        path_figure(ways, workspace_of(machine)),
        PNG,
    )


def sampled_poses(machine: MachineSpecification, arm: Arm, controllers: Sequence[ControllerResult]) -> Figure:
    """Starts and targets of the longest evaluation: the former are drawn as all poses while learning."""
    longest = max(controllers, key=lambda controller: controller.metrics["n_episodes"])
    episodes = load_episodes(longest.evaluation / "episodes.npz")
    clouds = {
        "starts, as in learning": cloud_of(arm, episodes.starts),
        "targets of evaluation": cloud_of(arm, episodes.targets),
    }
    return Figure(
        "Sampled poses",
        f"The {len(episodes.starts)} starts of the evaluation, drawn as starts and targets are while learning, and its "
        "targets, whose pitch and height are bounded further. From above and from the side, coloured by pitch; "
        "outlined is the restricted workspace W+.",
        cloud_figure(clouds, workspace_of(machine)),
        PNG,
    )


def film(
    machine: MachineSpecification,
    machine_directory: Path,
    controller: ControllerResult,
    episode: int,
    frames_per_second: int,
) -> Figure:
    """One evaluated episode.

    Raises:
        InputError: the evaluation lacks this episode.
        RenderingUnavailableError: this computer cannot render.
    """
    n_episodes = int(controller.metrics["n_episodes"])
    if episode >= n_episodes:
        raise InputError(
            f"{controller.evaluation}: has {n_episodes} episodes, counted from 0; there is no episode {episode}"
        )
    shown = episode_film(
        machine,
        machine_directory,
        controller.title,
        load_traces(controller.evaluation / "traces.npz"),
        load_episodes(controller.evaluation / "episodes.npz"),
        episode,
        frames_per_second,
    )
    return Figure(
        controller.title,
        f"Seed {controller.seed}, episode {episode}: {shown.outcome}.",
        film_bytes(shown, frames_per_second),
        WEBP,
    )


def save_pictures(directory: Path, pictures: Pictures) -> None:
    """Write each picture as a file, and an index of titles and captions."""
    directory.mkdir(parents=True, exist_ok=True)
    index: dict[str, object] = {"unavailable": pictures.unavailable}
    for group, figures in (("films", pictures.films), ("figures", pictures.figures)):
        entries = {}
        for name, figure in figures.items():
            file = f"{'film_' if group == 'films' else ''}{name}{SUFFIXES[figure.media_type]}"
            (directory / file).write_bytes(figure.content)
            entries[name] = {"file": file, "title": figure.title, "caption": figure.caption}
        index[group] = entries
    write_json(directory / INDEX, index)


def load_pictures(directory: Path) -> Pictures:
    """Read the output of `save_pictures`.

    Raises:
        InputError: a file is missing or damaged.
    """
    index = read_json(directory / INDEX)
    media_types = {suffix: media_type for media_type, suffix in SUFFIXES.items()}

    def load(entries: Mapping[str, Mapping[str, str]]) -> dict[str, Figure]:
        figures = {}
        for name, entry in entries.items():
            path = require_file(directory / entry["file"])
            figures[name] = Figure(
                entry["title"], entry["caption"], path.read_bytes(), media_types[path.suffix]
            )
        return figures

    return Pictures(load(index["films"]), index["unavailable"], load(index["figures"]))
