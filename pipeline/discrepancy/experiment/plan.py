"""A planned experiment, as a file that a machine plays and a page that an operator reads."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import EnvelopeConfig

FILE = "experiment.json"
SCHEMA_VERSION = 1
LATE, SETTLE_S = 1.5, 10.0  # of the predicted duration; until all nodes have heard of each other


@dataclass(frozen=True)
class Step:
    """One line of the plan: bring the arm somewhere, or hold a command for some time.

    Attributes:
        goal: Position by joint, rad (m), to which the joints are brought; empty: a command is held.
        command: By joint, in [-1, 1]; joints left out are not commanded.
        seconds: How long the command is held.
    """

    goal: Mapping[str, float] = field(default_factory=dict)
    command: Mapping[str, float] = field(default_factory=dict)
    seconds: float = 0.0


@dataclass(frozen=True)
class Separation:
    """How well a plan tells two explanations apart.

    Attributes:
        explanations: Their names; the first one is taken to be true.
        evidence: Expected logarithm of the likelihood ratio of the first to the second.
    """

    explanations: tuple[str, str]
    evidence: float


@dataclass(frozen=True)
class Plan:
    """An experiment.

    Attributes:
        machine: Its name.
        steps: In order.
        separations: Of every two explanations.
        left_out: Explanations that it does not decide: without an equation, or not to be told inside the envelope.
        envelope: Region that no prediction leaves.
        speed: By joint, rad/s (m/s), under a full command.
        tolerance: By joint, rad (m): how near to a goal is near enough.
        rest_s: After which a joint whose command has ended stands.
        stopping_s: From a joint state until a joint stands that a supervisor stops because of it.
        motion_s: Seconds in which a joint is commanded, as predicted.
        duration_s: Seconds in all, as predicted.
        is_cold: Whether the machine has to stand until it is cold before the recording begins.
    """

    machine: str
    steps: Sequence[Step]
    separations: Sequence[Separation]
    left_out: Sequence[str]
    envelope: EnvelopeConfig
    speed: Mapping[str, float]
    tolerance: Mapping[str, float]
    rest_s: float
    stopping_s: float
    motion_s: float = 0.0
    duration_s: float = 0.0
    is_cold: bool = False

    @property
    def start(self) -> Mapping[str, float]:
        """Where the arm is to stand at the beginning, by joint."""
        return self.steps[0].goal

    @property
    def longest_s(self) -> float:
        """After which a machine that follows the plan is done, however often it has to aim again."""
        return LATE * self.duration_s + SETTLE_S

    def write(self, path: Path) -> None:
        """Write a JSON file."""
        write_json(path, {"schema_version": SCHEMA_VERSION, **asdict(self)}, allow_nan=False)

    @property
    def sentence(self) -> str:
        """What to record next, in a sentence."""
        worst = min(self.separations, key=lambda of: of.evidence)
        joints = list(dict.fromkeys(name for step in self.steps for name in step.command))
        return (
            f"Play {FILE}: {self.motion_s:.0f} s of motion of {', '.join(joints)} within "
            f"{self.duration_s / 60:.1f} minutes. Of {' and '.join(worst.explanations)}, each as likely now, "
            f"the right one is then expected to have {1.0 / (1.0 + math.exp(-worst.evidence)):.0%} of the probability."
        )


def read_plan(path: Path, machine: MachineSpecification) -> Plan:
    """Read a plan of the machine.

    Raises:
        InputError: The file is missing or damaged, or of another machine.
    """
    remedy = f"name the {FILE} that close_loop wrote"
    try:
        content: dict[str, Any] = json.loads(path.read_text())
        content.pop("schema_version")
        content["steps"] = [_checked(Step(**step), machine, path) for step in content["steps"]]
        content["separations"] = [
            Separation(tuple(of["explanations"]), float(of["evidence"])) for of in content["separations"]
        ]
        content["envelope"] = EnvelopeConfig(**content["envelope"])
        plan = Plan(**content)
        is_fast = all(of > 0 for of in plan.speed.values())
        is_complete = is_fast and set(plan.start) == set(plan.speed) == set(plan.tolerance) == set(
            machine.joint_names
        )
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; {remedy}") from error
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise InputError(f"{path}: not a plan ({error}); {remedy}") from error
    if plan.machine != machine.name or not is_complete:
        raise InputError(f"{path}: is of machine {plan.machine}, not of {machine.name}; {remedy}")
    return plan


def _checked(step: Step, machine: MachineSpecification, path: Path) -> Step:
    unknown = (set(step.goal) | set(step.command)) - set(machine.joint_names)
    values = [*step.goal.values(), *step.command.values(), step.seconds]
    commands = np.array([*step.command.values(), 0.0], float)
    if unknown or not np.isfinite(values).all() or step.seconds < 0 or np.abs(commands).max() > 1:
        raise InputError(f"{path}: no step of {machine.name}: {asdict(step)}")
    return step
