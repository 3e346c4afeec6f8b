"""Closing the loop: from logs measured on the machine to the effect that its model lacks.

Order of things: the diagnosis model and its own misfit on nominal logs; the measured rows' split; the search on rows
for fitting and selection; then, once, the confirmation rows: the gate, the errors before and after, and the baselines.
"""

import functools
import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtr

from pipeline.discrepancy.common_speed import FAMILY as SUPPLY
from pipeline.discrepancy.common_speed import common_speed_candidates, common_speed_p
from pipeline.discrepancy.diagnosis_model import is_known, train_diagnosis_model
from pipeline.discrepancy.document import document_of
from pipeline.discrepancy.finetuning import fine_tune
from pipeline.discrepancy.found import Found, residual_of, values_of
from pipeline.discrepancy.gate import can_be_shifted, lower_bound, placebo_p, pooled, rank_p
from pipeline.discrepancy.gathering import evidence_of
from pipeline.discrepancy.held_out_errors import WindowErrors, starts_within, window_errors
from pipeline.discrepancy.misfit import misfit_covariance
from pipeline.discrepancy.plausibility import OSCILLATION, is_dependence
from pipeline.discrepancy.refine import parameter_covariance, refine
from pipeline.discrepancy.regression import Folds
from pipeline.discrepancy.residual_network import fit_residual_network
from pipeline.discrepancy.result import ClosedLoop
from pipeline.discrepancy.ring_down import ring_down
from pipeline.discrepancy.sampling_phase import sampling_phases
from pipeline.discrepancy.screen import Rows, averaged
from pipeline.discrepancy.search import Search, null_gains
from pipeline.discrepancy.sequences import Sequences, side_by_side
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.simulation import Simulation
from pipeline.discrepancy.splits import Purpose, split_rows
from pipeline.discrepancy.stops import Encoder, encoders_of
from pipeline.discrepancy.verdict import MERGED, Effect, effects_of
from pipeline.discrepancy.whole_machine import of_one_cause
from pipeline.dynamics.errors import Predictor
from pipeline.dynamics.model import DynamicsModel
from pipeline.dynamics.network import Parameters
from pipeline.dynamics.predictor import LearnedPredictor
from pipeline.effects.effect import Setting
from pipeline.effects.store import KNOWN, ActiveEffects, predictor
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory, validation_part
from pipeline.machine.specification import CommandKind, MachineSpecification

LEVELS = (1, 80, 1000)
TRAINED = ("finetune", "blackbox_residual")  # of the baselines
NULL_BLOCK_ROWS = 1200
FOLD_ROWS = 200
TOLD_STEPS = 0.1
MISFIT_PARTS = 6  # of the nominal logs: four minutes each, of 24

Say = Callable[[str], None]


def close_loop(
    nominal: Sequence[Trajectory],
    measured: Sequence[Trajectory],
    machine: MachineSpecification,
    model: DynamicsModel,
    parameters: Parameters,
    config: CloseLoopConfig,
    say: Say = lambda _: None,
) -> ClosedLoop:
    """Find the effects that `model` lacks of the machine that was measured.

    Args:
        nominal: Logs of the machine that the model describes.
        measured: Logs of the machine as it is.
        machine: The machine.
        model: The frozen model f_θ.
        parameters: θ.
        config: Section `close_loop`.
        say: Called with one sentence per step.

    Raises:
        InputError: Logs are too short.
    """
    return Loop(nominal, measured, machine, model, parameters, config, say).run()


class Loop:
    """One run; see `close_loop`. The report's evidence is gathered from it afterwards."""

    def __init__(self, nominal, measured, machine, model, parameters, config, say) -> None:  # type: ignore[no-untyped-def]
        self.nominal: Sequence[Trajectory] = nominal
        self.measured: Sequence[Trajectory] = measured
        self.machine: MachineSpecification = machine
        self.model: DynamicsModel = model
        self.parameters: Parameters = parameters
        self.config: CloseLoopConfig = config
        self.joints = list(machine.joint_names)
        self.units = list(machine.units)
        self.seconds: dict[str, float] = {}
        self.steps: list[str] = []
        self._predictors: dict[tuple[int, ...], tuple[list[Effect], Predictor]] = {}
        self._tell = say
        self._mark = time.monotonic()

    def say(self, sentence: str) -> None:
        """Tell the user, and the report."""
        self.steps.append(sentence)
        self._tell(sentence)

    def lap(self, part: str) -> None:
        """Note how long a part took."""
        now = time.monotonic()
        self.seconds[part] = now - self._mark
        self._mark = now

    def run(self) -> ClosedLoop:
        """Do everything in its order."""
        self._diagnose()
        found = self._search()
        effects = self._gate(found)
        return self._confirm(effects)

    def _diagnose(self) -> None:
        machine, config = self.machine, self.config
        rows = side_by_side(self.nominal, machine.dt_s)
        lower, upper = machine.lower, machine.upper
        diagnosis = train_diagnosis_model(rows, lower, upper, machine.dt_s, config.diagnosis, config.seed)
        self.setting = Setting(machine.dt_s, lower, upper, diagnosis.scales.speed)
        is_discrete = machine.command_kind is CommandKind.discrete
        effects = [
            effect
            for family, effect in KNOWN.items()
            if family not in config.exclude and not (is_discrete and effect.needs_proportional_commands)
        ]
        self.lap("diagnosis model")
        # More nominal rows than this make the null no better known, but the search on them slow.
        n_rows = max(1, config.search.nominal_rows // len(rows.is_row))
        known = rows
        rows = Sequences(*(column[:, :n_rows] for column in rows))
        simulation = Simulation(diagnosis, rows, effects, self.setting, diagnosis.left_out[..., :n_rows])
        simulation.set_phases(sampling_phases(simulation, rows.is_row))
        weight = is_known(known, rows, diagnosis.scales)
        residual = (averaged(weight.astype(float), rows.is_row) > 0.999) * averaged(
            rows.velocity - simulation.velocities([{}])[0], rows.is_row
        )
        self.floor = np.maximum(np.mean(residual**2, axis=0), 1e-12)
        fold = np.where(rows.is_row, (np.arange(rows.is_row.shape[1]) // NULL_BLOCK_ROWS) % 2, 0)
        self.nominal_simulation = simulation
        self.nominal_rows = self._rows(rows, rows.is_row, fold, weight)
        self.null = null_gains(simulation, self.nominal_rows, config.exclude)
        self.lap("search on nominal logs")
        self.diagnosis = diagnosis
        self.say(
            "On nominal logs that its members did not see, the diagnosis model is off by "
            + ", ".join(
                f"{j} {1e3 * np.sqrt(f):.1f} m{u}/s"
                for j, f, u in zip(self.joints, self.floor, self.units, strict=True)
            )
            + " (root mean square)."
        )
        self.sequences = side_by_side(self.measured, machine.dt_s)
        self.simulation = Simulation(diagnosis, self.sequences, effects, self.setting)
        purposes, self.rule = split_rows([len(t) for t in self.measured], machine.dt_s, config.split)
        self.purposes = purposes
        if not any(len(starts_within(purpose == Purpose.confirm, 80)) for purpose in purposes):
            raise InputError(
                f"measured logs: {sum(map(len, self.measured)) * machine.dt_s:.0f} s are too short to hold a window "
                "of 80 steps back from the fit; record three minutes or more"
            )
        self.label = np.zeros(self.sequences.is_row.shape, np.int8)
        for index, purpose in enumerate(purposes):
            self.label[index, : len(purpose)] = purpose
        self.weight = is_known(known, self.sequences, diagnosis.scales)
        used = self.sequences.is_row & np.isin(self.label, (Purpose.fit, Purpose.select))
        phases = sampling_phases(self.simulation, used)
        self.simulation.set_phases(phases)
        if np.any(np.abs(phases) > TOLD_STEPS):
            self.say(
                "All joints of the measured logs respond alike by "
                + ", ".join(f"{1e3 * machine.dt_s * phase:.0f}" for phase in phases)
                + " ms later than on nominal logs: when their recordings began, which is taken out of what follows."
            )
        self.rows = self._rows(self.sequences, used, (self.label == Purpose.select).astype(int), self.weight)
        confirm = self.sequences.is_row & (self.label == Purpose.confirm)
        halves = np.broadcast_to((np.arange(confirm.shape[1]) // FOLD_ROWS) % 2, confirm.shape)
        self.confirm = self._rows(self.sequences, confirm, halves, self.weight)

    def _rows(self, rows: Sequences, used: np.ndarray, fold: np.ndarray, weight: np.ndarray) -> Rows:
        block_rows = max(1, round(self.config.search.block_s / self.machine.dt_s))
        block = np.arange(used.shape[1]) // block_rows + (np.arange(used.shape[0]) * used.shape[1])[:, None]
        numbers = averaged(np.broadcast_to(block, used.shape).astype(float), used).astype(int)
        unique, index = np.unique(numbers, return_inverse=True)
        folds = Folds((averaged(fold.astype(float), used) > 0.5).astype(int), index, max(len(unique), 1))
        return Rows(used, folds, self.floor, (averaged(weight.astype(float), used) > 0.999).astype(float))

    def _search(self) -> list[Found]:
        moving = np.abs(self.simulation.velocities([{}])[0]) > 0.3 * self.diagnosis.scales.speed
        self.moving_s = (moving & self.rows.is_used[..., None]).sum(axis=(0, 1)) * self.machine.dt_s
        self.excited = [
            j for j in range(len(self.joints)) if self.moving_s[j] >= self.config.gate.smallest_excitation_s
        ]
        self.search = Search(
            self.simulation,
            self.rows,
            self.null,
            self.config.search,
            self.config.exclude,
            self._encoders(),
            self.joints,
            self.say,
        )
        found = self.search.run()
        self.simulation.onsets = {}
        self.n_hypotheses = max(1, len(self.search.first))
        self.lap("search on measured logs")
        return found

    def _encoders(self) -> dict[int, Encoder]:
        """By the stops that were met on rows for fitting and selection."""
        rows = self.sequences._replace(is_row=self.rows.is_used)
        lower, upper, speed = self.machine.lower, self.machine.upper, self.setting.speed_scale
        return encoders_of(self.nominal_simulation.sequences, rows, lower, upper, speed)

    def residual(self, rows: Rows, found: Sequence[Found]) -> np.ndarray:
        """(N, n_joint) residual of the diagnosis model with the effects found."""
        return residual_of(self.simulation, rows, found)

    def _gate(self, found: list[Found]) -> list[Effect]:
        """Open the confirmation rows."""
        gate, seed = self.config.gate, self.config.seed
        passed, self.p_values, self.shares = [], {}, {}
        everything, fitted = self.residual(self.confirm, found), self.residual(self.rows, found)
        widths_s = {
            f.candidate.joint: f.candidate.point["width"] for f in found if f.candidate.family == SUPPLY
        }
        if widths_s:
            active = values_of(self.simulation, found)
            confirmed = {c.joint: c for c in common_speed_candidates(self.simulation, active, self.confirm)}
            p_of_common = common_speed_p(self.simulation, active, self.rows, widths_s, seed)
        together = self._together(found, everything)
        for effect in found:
            joint, largest_p = effect.candidate.joint, gate.largest_p
            if effect.candidate.family == SUPPLY:
                share = bound = confirmed[joint].share
                p = min(p_of_common * self.n_hypotheses, 1.0)
            else:
                others = [f for f in found if f is not effect]
                known = ~self._may_set_in(effect)
                without = known * self.residual(self.confirm, others)[:, joint]
                after = known * everything[:, joint]
                share, bound = lower_bound(without, after, self.confirm, gate.resamples, seed)
                fitted_without = self.residual(self.rows, others)[:, joint]
                change = fitted_without - fitted[:, joint]
                acting = np.flatnonzero(
                    change
                )  # what sets in mid-way is compared with itself, not with nothing
                since = acting[0] if len(acting) else 0
                if can_be_shifted(change[since:]):
                    p = placebo_p(fitted_without[since:], change[since:], self.n_hypotheses, seed)
                else:
                    largest_p = gate.largest_rank_p
                    gain = without**2 - after**2
                    folds = self.confirm.folds
                    p = rank_p(np.bincount(folds.block, gain, minlength=folds.n_blocks), len(found))
            is_confirmed = bound > gate.smallest_improvement
            is_pooled = effect.candidate.family in together
            if is_pooled:
                # One cause is confirmed on its joints together, and left off those on which it is no help.
                bound = together[effect.candidate.family]
                is_confirmed = bound > gate.smallest_improvement and share > 0.0
            if effect.candidate.deviation is not None:
                # Seen at the stops; speeds, which may hardly depend on the place, must not speak against it.
                p = float(min(1.0, ndtr(-self.search.encoders[joint].z) * len(self.joints)))
                is_confirmed = share > -gate.smallest_improvement
            name = f"{effect.candidate.family} on {self.joints[joint]}"
            least = f"with its other joints at least {bound:.0%}" if is_pooled else f"at least {bound:.0%}"
            removed = f"on confirmation rows it removes {share:.0%} ({least}) of the squares, p = {p:.1g}"
            self.shares[effect.candidate.key] = share
            if is_confirmed and p < largest_p:
                passed.append(effect)
                self.p_values[effect.candidate.key] = p
                self.say(f"{name} is confirmed: {removed}.")
            else:
                self.say(f"{name} is not confirmed: {removed}.")
        passed = self._refitted(passed, found)
        self.lap("gate")
        return effects_of(passed, self.excited, "timing" not in self.config.exclude)

    def _refitted(self, passed: list[Found], found: Sequence[Found]) -> list[Found]:
        """What was confirmed, with values that no longer make room for what was not; fitted on the rows for fitting."""
        if len(passed) in (0, len(found)):
            return passed
        self.search.found = refine(self.simulation, self.rows, passed)
        return self.search.found

    def _may_set_in(self, found: Found) -> np.ndarray:
        """(N,) confirmation rows of which the rows for fitting cannot say whether the effect has set in by then."""
        between = found.candidate.onset_between
        if between is None:
            return np.zeros(len(self.confirm.folds.fold), bool)
        stamps = self.sequences.stamp_ns
        return (
            averaged(((stamps >= between[0]) & (stamps < between[1])).astype(float), self.confirm.is_used)
            > 0.0
        )

    def _together(self, found: Sequence[Found], everything: np.ndarray) -> dict[str, float]:
        """Lower bound of what a cause removes on all its joints together, for causes that several joints have."""
        bounds = {}
        for family in of_one_cause([f.candidate for f in found], len(self.joints)):
            if family == SUPPLY:
                continue
            members = [f for f in found if f.candidate.family == family]
            joints = [f.candidate.joint for f in members]
            without = self.residual(self.confirm, [f for f in found if f not in members])
            before, after = (pooled(residual, joints, self.floor) for residual in (without, everything))
            bounds[family] = lower_bound(
                before, after, self.confirm, self.config.gate.resamples, self.config.seed
            )[1]
        return bounds

    @functools.cached_property
    def covariance(self) -> dict:
        """Of all parameters found, per joint: coordinates, and what scatter and misfit make of them."""
        found = self.search.found
        misfit = misfit_covariance(self.nominal_simulation, self.nominal_rows, found, MISFIT_PARTS)
        return {
            joint: (coordinates, scatter + misfit[joint])
            for joint, (coordinates, scatter) in parameter_covariance(
                self.simulation, self.rows, found
            ).items()
        }

    def _active(self, effects: Sequence[Effect]) -> ActiveEffects | None:
        found = [
            member for effect in effects for member in effect.members if member.candidate.family != SUPPLY
        ]
        if not found:
            return None
        onset_ns: dict[str, int] = {}
        for member in found:
            onset = member.candidate.onset
            if onset is not None:
                family = member.candidate.family
                onset_ns[family] = min(onset, onset_ns.get(family, onset))
        return ActiveEffects(self.setting, values_of(self.simulation, found), onset_ns)

    def predictor(self, effects: Sequence[Effect]) -> Predictor:
        """The frozen model with these effects; compiled once, however often it is asked for."""
        key = tuple(id(member) for effect in effects for member in effect.members)
        if key not in self._predictors:
            # kept with the effects, so that no identity is used again
            built = predictor(self.model, self.parameters, self._active(effects))
            self._predictors[key] = list(effects), built
        return self._predictors[key][1]

    def errors(self, of: Predictor, horizon: int) -> WindowErrors:
        """On confirmation rows."""
        allowed = [purpose == Purpose.confirm for purpose in self.purposes]
        return window_errors(of, self.measured, allowed, horizon)

    def _confirm(self, effects: list[Effect]) -> ClosedLoop:
        before = LearnedPredictor(self.model, self.parameters)
        of_before = {horizon: self.errors(before, horizon) for horizon in LEVELS}
        effects = self._worth_a_name(self._without_harm(effects, of_before[80]), of_before[80])
        after = self.predictor(effects)
        errors = {
            horizon: (of_before[horizon], self.errors(after, horizon) if effects else of_before[horizon])
            for horizon in LEVELS
        }
        floor = {h: self._on_nominal(before, h) for h in LEVELS}
        self.lap("errors before and after")
        rivals = self._baselines(effects)
        baselines = {name: {h: self.errors(of, h).rmse for h in LEVELS} for name, of in rivals.items()}
        on_nominal = {"effects": self._on_nominal(after, 80) if effects else floor[80]}
        on_nominal |= {name: self._on_nominal(rivals[name], 80) for name in TRAINED}
        self.lap("baselines")
        document = document_of(self, effects, errors, floor, baselines, on_nominal)
        evidence = evidence_of(self, effects, errors, floor, baselines)
        self.lap("evidence")
        return ClosedLoop(document, self._active(effects), evidence)

    def _without_harm(self, effects: list[Effect], before: WindowErrors) -> list[Effect]:
        """Drop the weakest effect of a joint whose open-loop error rises beyond the margin, until none does."""
        limit = before.rmse * (1.0 + self.config.gate.worse_margin)
        while effects:
            worse = set(np.flatnonzero(self.errors(self.predictor(effects), 80).rmse > limit).tolist())
            suspects = [e for e in reversed(effects) if e.family != SUPPLY and self._may_harm(e, worse)]
            if not worse or not suspects:
                break
            # The weakest whose absence restores the joints; where none does by itself, the weakest.
            cured = [s for s in suspects if len(suspects) > 1 and self._is_cured(effects, s, worse, limit)]
            guilty = (cured or suspects)[0]
            rest = self._spared(guilty, worse)
            place = effects.index(guilty)
            effects = [*effects[:place], *rest, *effects[place + 1 :]]
            self.say(
                f"{guilty.family} is dropped"
                + (" on some joints" if rest else "")
                + ": it makes the open-loop error of a joint larger."
            )
        return effects

    def _may_harm(self, effect: Effect, joints: set[int]) -> bool:
        reaches = any(KNOWN[m.candidate.family].reaches_other_joints for m in effect.members)
        return reaches or bool(set(effect.joints) & joints)

    def _spared(self, guilty: Effect, worse: set[int]) -> list[Effect]:
        """What stays of an effect: its part on the joints that are not worse, where it is one cause of several."""
        spared = [m for m in guilty.members if m.candidate.joint not in worse]
        is_merged = guilty.members[0].candidate.family in MERGED
        return [Effect(guilty.family, spared)] if is_merged and 0 < len(spared) < len(guilty.members) else []

    def _is_cured(
        self, effects: Sequence[Effect], without: Effect, worse: set[int], limit: np.ndarray
    ) -> bool:
        rest = [part for e in effects for part in (self._spared(e, worse) if e is without else [e])]
        rmse = self.errors(self.predictor(rest), 80).rmse
        return all(rmse[joint] <= limit[joint] for joint in worse)

    def error_reduction(self, effect: Effect, before: WindowErrors) -> float:
        """Share of the squared error over 80 steps that an effect removes by itself, its joints scaled alike."""
        joints = effect.joints
        alone = self.errors(self.predictor([effect]), 80)
        if not len(alone.squares) or not len(before.squares):
            return 0.0
        scale = np.maximum(before.squares.mean(axis=0)[joints], 1e-18)
        return 1.0 - float(np.sum(alone.squares.mean(axis=0)[joints] / scale) / len(joints))

    def _worth_a_name(self, effects: list[Effect], before: WindowErrors) -> list[Effect]:
        """Effects that show: in the prediction or, the first, in a good part of the residual of the speeds."""
        kept = []
        for number, effect in enumerate(effects):
            reduction = self.error_reduction(effect, before)
            share = max(self.shares[member.candidate.key] for member in effect.members)
            shows = number == 0 and (
                effect.family == SUPPLY or share > self.config.gate.smallest_share or self._rings(effect)
            )
            if reduction < self.config.gate.smallest_error_reduction and not shows:
                self.say(f"{effect.family} is not named: it removes {reduction:.0%} of the open-loop error.")
            else:
                kept.append(effect)
        return kept

    def _rings(self, effect: Effect) -> bool:
        """Whether it is a resonance that stops show: of one whose phase is soon lost, no prediction removes much."""
        if effect.family != OSCILLATION:
            return False
        joint, used = effect.joints[0], self.rows.is_used
        return ring_down(self.sequences, used, joint, self.machine.dt_s, self.config.seed) is not None

    def _on_nominal(self, of: Predictor, horizon: int) -> np.ndarray:
        """(n_joint,) error on the nominal logs' validation parts: what a correction costs the machine as it was."""
        parts = [validation_part(t) for t in self.nominal]
        return window_errors(of, parts, [np.ones(len(p), bool) for p in parts], horizon).rmse

    def _baselines(self, effects: Sequence[Effect]) -> dict[str, Predictor]:
        pieces = list(self._pieces())
        arguments = (
            self.model,
            self.parameters,
            pieces,
            self.machine,
            self.config.baselines,
            self.config.seed,
        )
        predictors: dict[str, Predictor] = {
            "finetune": LearnedPredictor(self.model, fine_tune(*arguments)),
            "blackbox_residual": fit_residual_network(*arguments),
        }
        wrong = self._wrong_effect(effects)
        if wrong is not None:
            predictors["wrong_effect"] = self.predictor([wrong])
        return predictors

    def _pieces(self):  # type: ignore[no-untyped-def]
        """Stretches of rows for fitting and for selection, as trajectories that mark the latter as validation."""
        for trajectory, purpose in zip(self.measured, self.purposes, strict=True):
            edges = [0, *(np.flatnonzero(np.diff(purpose)) + 1).tolist(), len(purpose)]
            for begin, end in itertools.pairwise(edges):
                if purpose[begin] in (Purpose.fit, Purpose.select):
                    rows = slice(begin, end)
                    yield replace(
                        trajectory,
                        **{
                            name: getattr(trajectory, name)[rows]
                            for name in ("t_s", "stamp_ns", "q", "qd", "a")
                        },
                        is_validation=np.full(end - begin, purpose[begin] == Purpose.select),
                    )

    def _wrong_effect(self, effects: Sequence[Effect]) -> Effect | None:
        """A middling fit of another family than was found, on the same joint."""
        if not effects or effects[0].members[0].candidate.family == SUPPLY:
            return None
        first = effects[0].members[0].candidate
        others = [
            c
            for c in self.search.first
            if c.joint == first.joint
            and c.family not in (first.family, SUPPLY)
            and not is_dependence(c)
            and c.gain > 0
        ]
        named = sorted(others, key=lambda c: -c.gain)
        if not named:
            return None
        middling = named[len(named) // 2]
        return Effect(middling.family, [Found(middling)])
