"""The screen: every effect of the catalogue, on every joint, scored on rows that its coefficients did not see.

Parameters that the model is linear in are found by least squares on the wrappers' tangents (for them this is the full
fit), the others are tried on their grids. A candidate's score is the held-out reduction of the squared residual in
units of the joint's noise floor.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Hypothesis, Simulation
from pipeline.discrepancy.selection.candidate import Candidate, Key, Nominal, scored
from pipeline.discrepancy.selection.linear_parameters import USUAL_SHARE, bounds_of, direction_of, freed_of
from pipeline.discrepancy.selection.regression import CrossValidatedFit, evidence
from pipeline.effects.chain import Chain
from pipeline.effects.dependence import Dependence
from pipeline.effects.effect import Effect, SensorEffect, Variant, VelocityEffect

TAKEN_TOGETHER = (
    "timing",
)  # on one joint the same wrapper as `delay`: equal delays of all joints are merged into it

# A coefficient that one half of the rows hardly excites is not believed on the other: before any rows it is about zero,
# within a share of what is plausible, and rows follow one another so closely that only some of them count.
INDEPENDENT_ROWS = 10.0


def screen(
    simulation: Simulation,
    active: Hypothesis,
    rows: ScoredRows,
    excluded: Sequence[str] = (),
    joints: Sequence[int] | None = None,
    nominal: Nominal = MappingProxyType({}),
) -> list[Candidate]:
    """Score every candidate beside the effects that are active already.

    Args:
        simulation: On the logs in question.
        active: Effects that were found before.
        rows: Rows in use.
        excluded: Families that are not tried.
        joints: Which joints; None: all.
        nominal: What reproducibly explains something of nominal logs: what candidates owe to it is told of them.

    Returns:
        The best point and variant of each (family, joint, source), by falling gain.
    """
    return _Screen(simulation, active, rows, excluded, joints, nominal).run()


class _Screen:
    def __init__(
        self,
        simulation: Simulation,
        active: Hypothesis,
        rows: ScoredRows,
        excluded: Sequence[str],
        joints: Sequence[int] | None,
        nominal: Nominal,
    ) -> None:
        self.simulation, self.active, self.rows, self.excluded = simulation, active, rows, excluded
        self.nominal = nominal
        self.n_joint = simulation.setting.n_joint
        self.joints = range(self.n_joint) if joints is None else joints
        self.u = simulation.nominal_velocities([active])[0]
        self.measured = rows.averaged(simulation.sequences.velocity)
        velocity = simulation.velocities([active])[0]
        self.reference = self._residual(velocity)
        # Beside effects that were found before, an effect on the velocity acts on what they leave: so hypotheses of one
        # family each are enough, whose compilations are there already. What encoders read is no velocity to act on:
        # their errors stay in the hypotheses, as stops and places are true ones.
        values = {f: of for f, of in active.values.items() if isinstance(simulation.effects[f], SensorEffect)}
        self.sensors = Hypothesis(values, active.onsets)
        moving = any(isinstance(simulation.effects[family], VelocityEffect) for family in active.values)
        self.before = self.u
        if moving or active.onsets:
            true = velocity / self._sensor_scale()
            self.before = jnp.asarray(np.moveaxis(true, 1, 0), jnp.float32)
        self.best: dict[Key, dict[int, Candidate]] = {}  # by number of parameters
        self.owed: dict[Key, float] = {}

    def run(self) -> list[Candidate]:
        for family, effect in self.simulation.effects.items():
            if family in self.excluded or family in TAKEN_TOGETHER:
                continue
            if isinstance(effect, Dependence):
                self._dependence(family, effect)
            else:
                self._named(family, effect)
        candidates = [replace(self._chosen(key), owed=self.owed.get(key, 0.0)) for key in self.best]
        return sorted(candidates, key=lambda candidate: -candidate.gain)

    def _sensor_scale(self) -> np.ndarray:
        """(B, T, n_joint) measured per true velocity."""
        sequences, effects = self.simulation.sequences, self.simulation.effects
        chain = Chain([type(effects[family]) for family in self.sensors.values], self.simulation.setting)
        values = jax.tree.map(jnp.asarray, self.sensors.values)
        scale = np.array(
            chain.sensor_scale(values, chain.true(values, jnp.asarray(sequences.q, jnp.float32)))
        )
        for (family, joint), onset in self.active.onsets.items():
            if family in self.sensors.values:
                scale[..., joint] = np.where(sequences.stamp_ns < onset, 1.0, scale[..., joint])
        return scale

    def _chosen(self, key: Key) -> Candidate:
        """The best of the fewest parameters, unless one with more is better by a margin, not by chance."""
        margin = self.simulation.effects[key[0]].parsimony
        chosen, *larger = (of_size for _, of_size in sorted(self.best[key].items()))
        for candidate in larger:
            if candidate.gain > chosen.gain + margin * abs(chosen.gain):
                chosen = candidate
        return chosen

    def _residual(self, velocity: np.ndarray) -> np.ndarray:
        return self.rows.weight * (self.measured - self.rows.averaged(velocity))

    def _tangent(self, tangent: np.ndarray) -> np.ndarray:
        return self.rows.weight * self.rows.averaged(tangent)

    def _named(self, family: str, effect: Effect) -> None:
        points = effect.grid()
        free = [joint for joint in self.joints if not self._is_active(family, joint)]
        if not free:
            return
        is_velocity = isinstance(effect, VelocityEffect)
        hypotheses = [self._at(family, effect, point, free, alone=is_velocity) for point in points]
        shared = self.before if is_velocity else None
        if points == [{}]:
            residuals = self.reference[None]
        elif effect.reaches_other_joints:
            residuals = self._one_joint_at_a_time(family, effect, points, free)
        elif not effect.variants()[0] or shared is None:
            residuals = np.stack([self._residual(v) for v in self.simulation.velocities(hypotheses, shared)])
        else:
            residuals = np.broadcast_to(self.reference, (len(points), *self.reference.shape))
        variants = effect.variants()
        freed = list(dict.fromkeys(one for variant in variants for one in variant))
        directions = [direction_of(family, effect, one, free) for one in freed]
        n = len(freed)
        tangents = None
        if n:
            flat_h = [hypothesis for hypothesis in hypotheses for _ in range(n)]
            flat_d = directions * len(points)
            tangents = np.stack(
                [self._tangent(t) for t in self.simulation.tangents(flat_h, flat_d, self.before)]
            ).reshape(len(points), n, *self.reference.shape)
        for joint in free:
            for index, of_card in enumerate(points):
                point = {name: float(effect.sizes(name)[joint] * value) for name, value in of_card.items()}
                for variant in variants:
                    chosen = [freed.index(one) for one in variant]
                    regressors = (
                        tangents[index][chosen][..., joint].T
                        if tangents is not None
                        else np.zeros((len(self.reference), 0))
                    )
                    lower, upper = bounds_of(effect, variant)
                    self._score(
                        family,
                        joint,
                        None,
                        point,
                        variant,
                        residuals[index][:, joint],
                        regressors,
                        lower,
                        upper,
                    )

    def _one_joint_at_a_time(
        self, family: str, effect: Effect, points: Sequence[Mapping[str, float]], joints: Sequence[int]
    ) -> np.ndarray:
        """(n_points, N, n_joint) residual of each joint while the effect acts on it alone."""
        residuals = np.zeros((len(points), *self.reference.shape))
        for joint in joints:
            hypotheses = [self._at(family, effect, point, [joint], alone=False) for point in points]
            for index, velocity in enumerate(self.simulation.velocities(hypotheses)):
                residuals[index, :, joint] = self._residual(velocity)[:, joint]
        return residuals

    def _dependence(self, family: str, effect: Dependence) -> None:
        free = list(self.joints)
        for source in range(effect.n_source):
            freed = freed_of(effect, source)
            directions = [direction_of(family, effect, one, free) for one in freed]
            hypotheses = [self.sensors] * len(directions)
            tangents = np.stack(
                [self._tangent(t) for t in self.simulation.tangents(hypotheses, directions, self.before)]
            )
            for joint in free:
                if effect.variable == "command" and source == joint:
                    continue
                lower, upper = bounds_of(effect, freed)
                named = source if effect.per_source else None
                self._score(
                    family,
                    joint,
                    named,
                    {},
                    freed,
                    self.reference[:, joint],
                    tangents[..., joint].T,
                    lower,
                    upper,
                )

    def _score(
        self,
        family: str,
        joint: int,
        source: int | None,
        point: Mapping[str, float],
        variant: Variant,
        residual: np.ndarray,
        regressors: np.ndarray,
        lower: np.ndarray,
        upper: np.ndarray,
    ) -> None:
        floor = self.rows.floor[joint]
        ridge = INDEPENDENT_ROWS * floor / (USUAL_SHARE * (upper - lower)) ** 2
        found: CrossValidatedFit = evidence(
            self.reference[:, joint], residual, regressors, self.rows.folds, lower, upper, ridge
        )
        candidate = scored(found, self.reference[:, joint], floor, family, joint, source, point, variant)
        key = (family, joint, source)
        if key in self.nominal:
            known, most_per_row = self.nominal[key]
            if known.point == point and known.freed == variant:
                after = residual - regressors @ known.coefficients
                squares = np.sum(self.reference[:, joint] ** 2) - np.sum(after**2)
                most = most_per_row * len(self.rows.folds.fold)
                self.owed[key] = float(np.clip(squares / floor, 0.0, most))
        of_size = self.best.setdefault(key, {})
        present = of_size.get(candidate.n_parameters)
        if present is None or candidate.gain > present.gain:
            of_size[candidate.n_parameters] = candidate

    def _is_active(self, family: str, joint: int) -> bool:
        if family not in self.active.values:
            return False
        neutral = self.simulation.effects[family].neutral()
        return any(
            np.any(np.asarray(value)[joint] != neutral[name][joint])
            for name, value in self.active.values[family].items()
        )

    def _at(
        self, family: str, effect: Effect, point: Mapping[str, float], joints: Sequence[int], alone: bool
    ) -> Hypothesis:
        beside = (self.sensors if alone else self.active).values
        of = {
            name: np.array(value, np.float64)
            for name, value in (beside.get(family) or effect.neutral()).items()
        }
        for name, value in point.items():
            of[name][list(joints)] = effect.sizes(name)[list(joints)] * value
        return Hypothesis({**beside, family: of}, self.active.onsets)
