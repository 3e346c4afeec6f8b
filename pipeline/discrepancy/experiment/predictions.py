"""What the explanations predict of manoeuvres and of whole plans: evidence, and whether the envelope is left."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.nominal.noise import noise_of
from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis
from pipeline.discrepancy.experiment.evidence import PairSums, pair_sums
from pipeline.discrepancy.experiment.explanations import Explanation, Remaining
from pipeline.discrepancy.experiment.manoeuvres import Manoeuvre, manoeuvres_at, to_a_stop
from pipeline.discrepancy.experiment.places import corners, places_for
from pipeline.discrepancy.experiment.plan import Plan
from pipeline.discrepancy.experiment.player import PlanPlayer
from pipeline.discrepancy.experiment.rollouts import Rollouts
from pipeline.dynamics.model.shown_motion import STANDING_SHARE
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import MACHINE_DIRECTORY, MachineSpecification
from pipeline.machine.workspace import Envelope, EnvelopeConfig

SURE = 3.0  # standard deviations of the error over 4 s: hardly a manoeuvre moves a joint longer one way
STEP = 0.25  # of a value's deviation, by which it is moved for its derivative
LENGTH_QUANTUM = 100  # rows: manoeuvres of similar length share one compilation
AT_ONCE = 1024  # sequences


class Played(NamedTuple):
    """A plan on the model.

    Attributes:
        leaves: Index of the step in which some prediction leaves the envelope; None: none does.
        motion_s: Seconds in which a joint is commanded, at most.
        duration_s: Seconds in all, at most.
    """

    leaves: int | None
    motion_s: float
    duration_s: float


class Predictions:
    """Of one machine and its remaining explanations.

    Attributes:
        rise_s: After which speeds are steady: the model's memory of commands.
        region: In which the experiment stays.
        stopping_s: From a joint state until a joint stands that a supervisor stops because of it.
        full_speed: (n_joint,) after `rise_s` of a full command, rad/s (m/s).
        tolerance: (n_joint,) by which an operator may miss a place, rad (m).
    """

    def __init__(self, diagnosis: Diagnosis, remaining: Remaining, error: np.ndarray) -> None:
        """Begin with the place of every joint.

        Args:
            diagnosis: Of the measured logs.
            remaining: Explanations.
            error: (n_joint,) the model's root mean square error over 80 steps on nominal logs, rad (m).

        Raises:
            InputError: The envelope names another joint.
        """
        logs, nominal = diagnosis.logs, diagnosis.nominal
        self._machine, self._nominal, self._remaining = logs.machine, nominal, remaining
        self._dt_s = logs.machine.dt_s
        self._speed = nominal.setting.speed_scale
        self._noise = noise_of(nominal, self._dt_s)
        self._rollouts = Rollouts(diagnosis.simulation, [of.hypothesis for of in remaining.explanations])
        self.rise_s = nominal.diagnosis.model.specification.lags * self._dt_s
        visited = nominal.sequences.q[nominal.sequences.is_row]
        self.region = _region_of(logs.machine, logs.config.experiment.envelope, visited)
        arm = load_arm(logs.machine, MACHINE_DIRECTORY) if logs.machine.workspace else None
        self._envelope = Envelope(logs.machine, arm, self.region)
        self.full_speed, run_out = self._stops(np.median(visited, axis=0))
        self.tolerance = 0.5 * run_out  # an operator who aims comes nearer than the machine runs on
        self.stopping_s = float(np.max(run_out / self.full_speed)) + logs.config.experiment.reaction_s
        self._error = SURE * error
        margin = self._error + self.tolerance
        limits = logs.machine.lower, logs.machine.upper
        self._places = places_for(self._envelope, visited, margin, limits)

    def _stops(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n_joint,) speeds at the end of a command of `rise_s`, rad/s (m/s), and how far joints move on, rad (m)."""
        n, held = len(q), round(self.rise_s / self._dt_s)
        commands = np.zeros((2 * held, n, n))
        commands[:held] = np.eye(n)
        at = self._rollouts.positions([NOMINAL], np.tile(q, (n, 1)), commands)[:, :, 0]
        least = STANDING_SHARE * self._speed
        speed = np.maximum(np.abs(at[held] - at[held - 1]).diagonal() / self._dt_s, least)
        return speed, np.maximum(np.abs(at[-1] - at[held]).diagonal(), self._dt_s * speed)

    def of_library(self) -> tuple[list[Manoeuvre], dict[int, list[PairSums]]]:
        """All manoeuvres, and of those that stay inside the sums of every pair."""
        explanations = self._remaining.explanations
        library: list[Manoeuvre] = []
        sums: dict[int, list[PairSums]] = {}
        for joint in sorted({joint for of in explanations for joint in of.joints}):
            name = self._machine.joint_names[joint]
            room = self.stopping_s * self._speed[joint]
            found = [
                manoeuvre
                for place in self._places[joint]
                for manoeuvre in (
                    *manoeuvres_at(
                        place._replace(below=place.below - room, above=place.above - room),
                        name,
                        self._speed,
                        self.rise_s,
                        self._nominal.is_switched,
                    ),
                    *to_a_stop(
                        place,
                        name,
                        (self._machine.lower[joint], self._machine.upper[joint]),
                        self._speed[joint],
                        self.rise_s,
                    ),
                )
            ]
            concerned = [k for k, of in enumerate(explanations) if joint in of.joints or not of.joints]
            for index, of_pairs in self._sums(found, concerned).items():
                sums[len(library) + index] = of_pairs
            library += found
        return library, sums

    def _sums(self, found: Sequence[Manoeuvre], concerned: Sequence[int]) -> dict[int, list[PairSums]]:
        own = [self._remaining.explanations[k] for k in concerned]
        hypotheses, first = _varied(own)
        if not found:
            return {}
        longest = max(round(of.seconds / self._dt_s) for of in found)
        n_rows = -(-longest // LENGTH_QUANTUM) * LENGTH_QUANTUM
        commands = np.stack([of.rows(n_rows, self._dt_s) for of in found], axis=1)
        q = np.stack([of.q for of in found])
        at_once = max(AT_ONCE // len(hypotheses), 1)
        result = {}
        for begin in range(0, len(found), at_once):
            part = np.minimum(np.arange(begin, begin + at_once), len(found) - 1)  # of one shape
            positions = self._rollouts.positions(hypotheses, q[part], commands[:, part])
            for place in range(min(at_once, len(found) - begin)):
                at = positions[: round(found[begin + place].seconds / self._dt_s) + 1, place]
                anyhow = self._reached(at_every_value(at, own, first))
                if self._stays(anyhow, self._error + self.tolerance):
                    given = commands[: len(at) - 1, begin + place]
                    result[begin + place] = self._of_pairs(at, given, concerned, own, first)
        return result

    def _of_pairs(
        self,
        at: np.ndarray,
        commands: np.ndarray,
        concerned: Sequence[int],
        own: Sequence[Explanation],
        first: Sequence[int],
    ) -> list[PairSums]:
        """Of positions (T + 1, H, n_joint) and commands (T, n_joint); of pairs that it does not concern zero."""
        v = np.diff(at, axis=0) / self._dt_s
        known = self._known(at[:-1, [first[k] for k in range(len(own))]], commands)
        n_unrepeated = at.shape[-1]
        place = {k: index for index, k in enumerate(concerned)}
        found = []
        for true, rival in self._remaining.pairs:
            n_columns = len(self._remaining.explanations[rival].freedoms) + n_unrepeated
            if true not in place or rival not in place:
                found.append(PairSums(0.0, np.zeros(n_columns), np.zeros((n_columns, n_columns))))
                continue
            a, b = first[place[true]], first[place[rival]]
            columns = [(v[:, b + 1 + k] - v[:, b]) / STEP for k in range(n_columns - n_unrepeated)]
            both = known[:, place[true]] & known[:, place[rival]]
            found.append(pair_sums(v[:, a], v[:, b], columns, both, self._noise))
        return found

    def _known(self, q: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """(T, K, n_joint) where nominal logs say how a joint moves, of positions of that shape."""
        q = np.moveaxis(q, 1, 0)
        given = np.broadcast_to(commands, q.shape)
        none = np.zeros(q.shape[:2])
        rows = Sequences(given, q, np.zeros(q.shape), none, none, none.astype(bool))
        return np.moveaxis(self._nominal.shows(rows), 0, 1)

    def _reached(self, positions: np.ndarray) -> np.ndarray:
        """(2, T, ..., n_joint) where the arm is, and where it would come if it were stopped there, rad (m)."""
        v = np.diff(positions, axis=0, prepend=positions[:1]) / self._dt_s
        return np.stack([positions, self._envelope.ahead(positions, v, self.stopping_s)])

    def _stays(self, reached: np.ndarray, margin: np.ndarray) -> bool:
        """Whether positions (..., n_joint) lie inside by so much in every joint, rad (m)."""
        cell = 0.5 * self._dt_s * self._speed  # of those nearer to each other one is checked
        at = np.unique(np.round(reached.reshape(-1, reached.shape[-1]) / cell).astype(int), axis=0) * cell
        return bool(self._envelope.holds_each(at[:, None] + corners(margin)).all())

    def play(self, plan: Plan) -> Played:
        """Play a plan on every explanation, as it is and with every value moved either way."""
        hypotheses = [of.hypothesis for of in self._remaining.explanations]
        for explanation in self._remaining.explanations:
            for freedom in explanation.freedoms:
                hypotheses += [explanation.varied(freedom, share) for share in (-1.0, 1.0)]
        players = [PlanPlayer(self._machine, plan) for _ in hypotheses]
        start = np.array([plan.start[name] for name in self._machine.joint_names])
        positions, commands, steps = self._rollouts.played(hypotheses, start, players)
        reached = self._reached(positions)
        leaves = next(
            (
                self._first_outside(reached[:, :, number], steps[:, number])
                for number in range(len(hypotheses))
                if not self._stays(reached[:, :, number], self._error)
            ),
            None,
        )
        moving = commands.any(axis=2).sum(axis=0)
        return Played(leaves, float(moving.max() * self._dt_s), len(positions) * self._dt_s)

    def _first_outside(self, reached: np.ndarray, steps: np.ndarray) -> int:
        """The step, of (T,), in which positions (2, T, n_joint) that leave the envelope do so first."""
        inside, outside = 0, len(steps)  # rows up to the one and the other
        while outside - inside > 1:
            middle = (inside + outside) // 2
            if self._stays(reached[:, :middle], self._error):
                inside = middle
            else:
                outside = middle
        return int(steps[outside - 1])


def _region_of(machine: MachineSpecification, config: EnvelopeConfig, visited: np.ndarray) -> EnvelopeConfig:
    """W+ as the operator widens it; of a machine without W+ the positions (N, n_joint) that nominal logs visited."""
    if machine.workspace is not None:
        return config
    ends = np.stack([visited.min(axis=0), visited.max(axis=0)], axis=1).tolist()
    return replace(config, joints={**dict(zip(machine.joint_names, ends, strict=True)), **config.joints})


def at_every_value(at: np.ndarray, explanations: Sequence[Explanation], first: Sequence[int]) -> np.ndarray:
    """(T + 1, V, n_joint) positions of all explanations, with each value moved by its deviation either way, too.

    Linearly, from what a part of the deviation does: a plan is played with the whole of it, and what then leaves the
    envelope is better not chosen.

    Args:
        at: (T + 1, H, n_joint) of `_varied`.
        explanations: That they are of.
        first: Of `_varied`.
    """
    found = [at[:, of] for of in first]
    for explanation, base in zip(explanations, first, strict=True):
        for number, freedom in enumerate(explanation.freedoms, start=1):
            slope = (at[:, base + number] - at[:, base]) / (freedom.way * STEP)
            found += [at[:, base] + share * slope for share in freedom.shares]
    return np.stack(found, axis=1)


def _varied(explanations: Sequence[Explanation]) -> tuple[list[Hypothesis], list[int]]:
    """Every explanation followed by itself with one value moved each; the index of each explanation among them."""
    hypotheses: list[Hypothesis] = []
    first = []
    for explanation in explanations:
        first.append(len(hypotheses))
        hypotheses.append(explanation.hypothesis)
        hypotheses += [explanation.varied(one, one.way * STEP) for one in explanation.freedoms]
    return hypotheses, first
