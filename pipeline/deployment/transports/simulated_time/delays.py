"""Delays of messages, decisions and timers: distributions measured on the real graph.

The file is JSON, written by the stage `measure_delays`: per link, quantiles of its delay at equally spaced
probabilities from 0 to 1, and the share of messages lost.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.components.controllers import ControllerKind
from pipeline.errors import InputError
from pipeline.files.atomic import write_json

SCHEMA_VERSION = 1
QUANTILES = 201  # equally spaced: the outermost steps hold half a percent each
DRAWN_AT_ONCE = 1024
LINKS = {
    "observation": "joint state, from the driver to whoever takes it",
    "command": "command, from component to component",
    "inference": "decision of the controller",
    "timer": "tick, from when it was due",
}
PLANNING = "planning"  # decision of a planner, which replaces "inference", if measured


class PlannerEffort(NamedTuple):
    """Cost of a planner's decision, independent of the computer.

    Attributes:
        model_steps: steps of the dynamics, over all sequences.
        model_parameters: number of its network's parameters.
    """

    model_steps: int
    model_parameters: int


@dataclass(frozen=True)
class Distribution:
    """Delays of one link.

    Attributes:
        quantiles_s: ascending, at equally spaced probabilities from 0 to 1.
        loss_probability: share of lost messages.
    """

    quantiles_s: np.ndarray
    loss_probability: float

    @classmethod
    def of(cls, delays_s: np.ndarray, n_lost: int = 0) -> "Distribution":
        """The distribution of measured delays, (n,), and of `n_lost` lost messages."""
        probabilities = np.linspace(0.0, 1.0, QUANTILES)
        return cls(np.quantile(delays_s, probabilities), n_lost / (n_lost + len(delays_s)))

    @classmethod
    def constant(cls, delay_s: float) -> "Distribution":
        """The distribution of a constant delay."""
        return cls(np.full(2, delay_s), 0.0)


class MeasuredDelays(NamedTuple):
    """Content of a file of delays.

    Attributes:
        links: distributions by link (`LINKS`, and `PLANNING` if measured with a planner).
        planner: the planner of `PLANNING`; None if the file does not describe it.
    """

    links: dict[str, Distribution]
    planner: PlannerEffort | None


class DelaySampler:
    """Draws delays from a distribution by inverting its quantile function (linear in between)."""

    def __init__(self, distribution: Distribution, seed: np.random.SeedSequence) -> None:
        self._distribution = distribution
        self._random = np.random.default_rng(seed)
        self._drawn: list[int] = []

    def draw_ns(self) -> int:
        """The next delay, ns; -1 for a lost message."""
        if not self._drawn:
            uniform = self._random.random((2, DRAWN_AT_ONCE))
            quantiles = self._distribution.quantiles_s
            delays = np.interp(uniform[0], np.linspace(0.0, 1.0, len(quantiles)), quantiles) * NANOSECONDS
            lost = uniform[1] < self._distribution.loss_probability
            self._drawn = np.where(lost, -1, np.round(delays)).astype(np.int64).tolist()
        return self._drawn.pop()


def save_delays(path: Path, links: Mapping[str, Distribution], measured: Mapping[str, Any]) -> None:
    """Write the file; `measured` describes the measurement, as JSON values."""
    content = {
        "schema_version": SCHEMA_VERSION,
        "measured": dict(measured),
        "links": {
            name: {
                "loss_probability": link.loss_probability,
                "quantiles_s": [round(float(value), 7) for value in link.quantiles_s],
            }
            for name, link in links.items()
        },
    }
    write_json(path, content)


def load_delays(path: Path) -> MeasuredDelays:
    """Read the file.

    Raises:
        InputError: the file is missing, or `save_delays` did not write it.
    """
    try:
        content = json.loads(path.read_text())
        if content["schema_version"] != SCHEMA_VERSION:
            raise InputError(f"{path}: schema_version {content['schema_version']}; run measure_delays anew")
        links = {
            name: Distribution(
                np.array(content["links"][name]["quantiles_s"], float),
                float(content["links"][name]["loss_probability"]),
            )
            for name in (*LINKS, *({PLANNING} & set(content["links"])))
        }
        planner = content["measured"].get("planner")
        effort = None if planner is None else PlannerEffort(**planner)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; measure it with measure_delays") from None
    except OSError as error:
        raise InputError(
            f"{path}: {error.strerror}; deployment.delays names a file of measure_delays"
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not a file of delays ({error!r}); run measure_delays anew") from None
    for name, link in links.items():
        if not _is_ascending_from_zero(link.quantiles_s):
            raise InputError(
                f"{path}: quantiles of {name} are not ascending from zero; run measure_delays anew"
            )
    if effort is not None and not all(type(number) is int and number > 0 for number in effort):
        raise InputError(f"{path}: {effort} has to be of whole positive numbers; run measure_delays anew")
    return MeasuredDelays(links, effort)


def _is_ascending_from_zero(quantiles_s: np.ndarray) -> bool:
    if quantiles_s.ndim != 1 or len(quantiles_s) < 2 or not np.isfinite(quantiles_s).all():
        return False
    return bool(quantiles_s[0] >= 0 and (np.diff(quantiles_s) >= 0).all())


def delays_of(
    links: Mapping[str, Distribution], kind: ControllerKind, unmeasured_planning_s: float | None
) -> tuple[dict[str, Distribution], bool]:
    """The links of a graph with this kind of controller, and whether its decisions were measured.

    Args:
        links: distributions of a file.
        kind: kind of the controller.
        unmeasured_planning_s: delay of a planner's decisions if the file lacks it, s.

    Raises:
        InputError: the controller is a planner of unknown decision time.
    """
    graph = {name: links[name] for name in LINKS}
    if kind is ControllerKind.ppo:
        return graph, True
    if PLANNING in links:
        return graph | {"inference": links[PLANNING]}, True
    if unmeasured_planning_s is None:
        raise InputError(
            "deployment.delays: the file says nothing of how long a planner takes; measure it with measure_delays, "
            "or assume it with deployment.unmeasured_planning_s"
        )
    return graph | {"inference": Distribution.constant(unmeasured_planning_s)}, False


def lengthened(links: Mapping[str, Distribution], extra_s: float) -> dict[str, Distribution]:
    """The links of a graph whose loop takes `extra_s` longer, s.

    Joint states take half of it. A command goes over two links, from server to interface to driver, each of which takes
    a quarter.
    """
    share = {"observation": 0.5, "command": 0.25}
    return {
        name: Distribution(link.quantiles_s + share.get(name, 0.0) * extra_s, link.loss_probability)
        for name, link in links.items()
    }


def no_delays() -> dict[str, Distribution]:
    """A graph without any delay."""
    return {name: Distribution.constant(0.0) for name in LINKS}
