"""Closing the loop: from logs measured on the machine to the effect that its model lacks.

Order of things: the diagnosis model and its own misfit on nominal logs; the measured rows' split; the search on rows
for fitting and selection; then, once, the confirmation rows: the gate, the errors before and after, and the baselines.
"""

import functools
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pipeline.discrepancy.acceptance.confirmation import Confirmation, in_words
from pipeline.discrepancy.acceptance.held_out_errors import WindowErrors, starts_within, window_errors
from pipeline.discrepancy.acceptance.open_loop_gate import OpenLoopGate
from pipeline.discrepancy.acceptance.remaining_signature import doubted_by_what_is_left
from pipeline.discrepancy.acceptance.size_of_an_effect import SIZES, why_it_is_none
from pipeline.discrepancy.baselines.all_baselines import trained_baselines, wrong_effect
from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour, learn_nominal_behaviour
from pipeline.discrepancy.diagnosis.sampling_phase import sampling_phases
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, alternating_folds, rows_in_blocks
from pipeline.discrepancy.diagnosis.sequences import side_by_side
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.discrepancy.diagnosis.splits import Purpose, split_rows
from pipeline.discrepancy.families.cold_oil import with_doubts_of_the_oil
from pipeline.discrepancy.families.contract_parameters import OF_95_PERCENT
from pipeline.discrepancy.families.gain_of_a_dependence import doubted_by_what_varies
from pipeline.discrepancy.families.plausibility import OSCILLATION, TIMING
from pipeline.discrepancy.families.ring_down import ring_down
from pipeline.discrepancy.families.stops import Encoder, encoders_of
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.selection.grouping import MachineEffect, effects_of, without_lags_of_one_cause
from pipeline.discrepancy.selection.parameter_misfit import misfit_covariance
from pipeline.discrepancy.selection.refine import parameter_covariance, refine
from pipeline.discrepancy.selection.search import Search
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, hypothesis_of, residual_of
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.discrepancy.verdict.build_report_data import evidence_of
from pipeline.discrepancy.verdict.document import document_of, parameters_of
from pipeline.discrepancy.verdict.result import ClosedLoop
from pipeline.dynamics.evaluation.errors import Predictor
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.effects.store import ActiveEffects, predictor
from pipeline.logs.tuples import Trajectory, validation_part
from pipeline.machine.specification import MachineSpecification

LEVELS = (1, 80, 1000)
FOLD_ROWS = 200
TOLD_STEPS = 0.1
FEWEST_OF_ALL = 3  # joints
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
    nominal_behaviour: NominalBehaviour | None = None,
    kept: Path | None = None,
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
        nominal_behaviour: What the nominal logs say, if it has been learned for other measured logs already.
        kept: File that keeps it; see `learn_nominal_behaviour`.

    Raises:
        InputError: That file is damaged, or cannot be written.
        UnusableLogs: The logs are too short.
    """
    return Loop(nominal, measured, machine, model, parameters, config, say, nominal_behaviour, kept).run()


class Loop:
    """One run; see `close_loop`. The report's evidence is gathered from it afterwards."""

    def __init__(  # type: ignore[no-untyped-def]
        self, nominal, measured, machine, model, parameters, config, say, nominal_behaviour=None, kept=None
    ) -> None:
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
        self._predictors: dict[tuple[int, ...], tuple[list[MachineEffect], Predictor]] = {}
        self._tell = say
        self.nominal_behaviour: NominalBehaviour | None = nominal_behaviour
        self.kept: Path | None = kept
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
        self._split()
        self._diagnose()
        found = self._search()
        effects = self._gate(found)
        return self._confirm(effects)

    def _split(self) -> None:
        """Which rows are for fitting, for selection and for confirmation; before anything is learned."""
        dt_s = self.machine.dt_s
        self.sequences = side_by_side(self.measured, dt_s, self.config.diagnosis.lags)
        self.purposes, self.rule = split_rows([len(t) for t in self.measured], dt_s, self.config.split)
        if not any(len(starts_within(purpose == Purpose.confirm, 80)) for purpose in self.purposes):
            raise UnusableLogs(
                "measured",
                f"{sum(map(len, self.measured)) * dt_s:.0f} s are too short to hold a window "
                "of 80 steps back from the fit; record three minutes or more",
            )
        self.label = np.zeros(self.sequences.is_row.shape, np.int8)
        for index, purpose in enumerate(self.purposes):
            self.label[index, : len(purpose)] = purpose

    def _diagnose(self) -> None:
        usual = self.nominal_behaviour
        if usual is None:
            usual = learn_nominal_behaviour(self.nominal, self.machine, self.config, self.lap, self.kept)
        self.usual = usual
        dt_s = self.machine.dt_s
        self.say(
            "On nominal logs that its members did not see, the diagnosis model is off by "
            + ", ".join(
                f"{j} {1e3 * np.sqrt(f):.1f} m{u}/s"
                for j, f, u in zip(self.joints, usual.floor, self.units, strict=True)
            )
            + " (root mean square)."
        )
        self.simulation = Simulation(usual.diagnosis, self.sequences, usual.effects, usual.setting)
        used = self.sequences.is_row & np.isin(self.label, (Purpose.fit, Purpose.select))
        self.phases = sampling_phases(self.simulation, used)
        self.simulation.set_phases(self.phases)
        if np.any(np.abs(self.phases) > TOLD_STEPS):
            self.say(
                "All joints of the measured logs respond alike by "
                + ", ".join(f"{1e3 * dt_s * phase:.0f}" for phase in self.phases)
                + " ms later than on nominal logs: when their recordings began, which is taken out of what follows."
            )
        self.is_known = usual.shows(self.sequences)
        block_rows = self.config.search.block_rows(dt_s)
        in_blocks = functools.partial(
            rows_in_blocks, is_known=self.is_known, floor=usual.floor, block_rows=block_rows
        )
        self.rows = in_blocks(used, (self.label == Purpose.select).astype(int))
        confirm = self.sequences.is_row & (self.label == Purpose.confirm)
        self.confirm = in_blocks(confirm, alternating_folds(confirm, block_rows, FOLD_ROWS))

    def _search(self) -> list[SelectedEffect]:
        moving = np.abs(self.simulation.velocities([NOMINAL])[0]) > 0.3 * self.usual.diagnosis.scales.speed
        is_used = moving & self.rows.is_used[..., None]
        n_known = (is_used & self.is_known).sum(axis=(0, 1))
        self.moving_s = n_known * self.machine.dt_s
        self.unknown_share = 1.0 - n_known / is_used.sum(axis=(0, 1)).clip(1)
        self.excited = [
            j for j in range(len(self.joints)) if self.moving_s[j] >= self.config.gate.smallest_excitation_s
        ]
        self.search = Search(
            self.simulation,
            self.rows,
            self.usual.null,
            self.config.search,
            self.config.exclude,
            self._encoders(),
            self.joints,
            self.excited,
            self.say,
            self.usual.present,
            self.usual.at_rest.tolist(),
        )
        found = self.search.run()
        self.n_hypotheses = max(1, len(self.search.first))
        self.lap("search on measured logs")
        return found

    def _encoders(self) -> dict[int, Encoder]:
        """By the stops that were met on rows for fitting and selection."""
        rows = self.sequences._replace(is_row=self.rows.is_used)
        lower, upper, speed = self.machine.lower, self.machine.upper, self.usual.setting.speed_scale
        return encoders_of(self.usual.simulation.sequences, rows, lower, upper, speed)

    def residual(self, rows: ScoredRows, found: Sequence[SelectedEffect]) -> np.ndarray:
        """(N, n_joint) residual of the diagnosis model with the effects found."""
        return residual_of(self.simulation, rows, found)

    def _gate(self, found: list[SelectedEffect]) -> list[MachineEffect]:
        """Open the confirmation rows."""
        self.searched = found
        confirmation = Confirmation(
            self.simulation,
            self.rows,
            self.confirm,
            self.search.encoders,
            self.config.gate,
            self.n_hypotheses,
            self.excited,
            len(self.joints),
            self.config.seed,
        )
        judgements = confirmation.judge(found)
        self.judgements = {f.candidate.key: j for f, j in zip(found, judgements, strict=True)}
        for effect in found:
            judgement = self.judgements[effect.candidate.key]
            self.say(in_words(effect, judgement, self.joints[effect.candidate.joint]))
        passed = [f for f in found if self.judgements[f.candidate.key].is_confirmed]
        passed = with_doubts_of_the_oil(passed, self.search.first)
        passed = doubted_by_what_varies(passed, found, self.search.first)
        passed = doubted_by_what_is_left(
            self.simulation,
            self.rows,
            passed,
            self.search.first,
            self.config.gate.largest_remainder,
            self.machine.dt_s,
        )
        if 0 < len(passed) < len(found):
            effects = self._refitted(passed)
        else:
            self.search.found = passed or found
            effects = self._grouped(passed)
        effects = self._beyond_misfit(effects)
        self.lap("gate")
        return effects

    def _beyond_misfit(self, effects: list[MachineEffect]) -> list[MachineEffect]:
        """Without what is no more than the diagnosis model is off by on nominal logs."""
        small = []
        for effect in (e for e in effects if e.family in SIZES):
            told = parameters_of(self, effect)
            # The misfit of more joints at once than before has shown on one or two joints, not on all of them.
            is_of_all = len(effect.joints) >= FEWEST_OF_ALL and set(effect.joints) >= set(self.excited)
            smallest = OF_95_PERCENT if is_of_all else self.config.gate.smallest_size
            why = why_it_is_none(effect.family, told, smallest, effect.joints)
            if why is not None:
                small.append(effect)
                self.say(f"{effect.family} is dropped: {why}.")
        if not small:
            return effects
        kept = [member for e in effects if e not in small for member in e.members]
        return self._refitted(doubted_by_what_varies(kept, self.searched, self.search.first))

    def _grouped(self, found: Sequence[SelectedEffect]) -> list[MachineEffect]:
        return effects_of(found, self.excited, TIMING not in self.config.exclude)

    def _refitted(self, found: list[SelectedEffect]) -> list[MachineEffect]:
        """Effects with values that no longer make room for what was dropped; fitted on the rows for fitting."""
        self.search.found = refine(self.simulation, self.rows, found)
        self.__dict__.pop("covariance", None)  # of what was found until now
        return self._grouped(self.search.found)

    @functools.cached_property
    def covariance(self) -> dict:
        """Of all parameters found, per joint: coordinates, and what scatter and misfit make of them."""
        found = self.search.found
        misfit = misfit_covariance(self.usual.simulation, self.usual.rows, found, MISFIT_PARTS)
        return {
            joint: (coordinates, scatter + misfit[joint])
            for joint, (coordinates, scatter) in parameter_covariance(
                self.simulation, self.rows, found
            ).items()
        }

    def _active(self, effects: Sequence[MachineEffect]) -> ActiveEffects | None:
        found = [member for effect in effects if effect.has_wrapper for member in effect.members]
        if not found:
            return None
        hypothesis = hypothesis_of(self.simulation, found)
        onset_ns: dict[str, dict[int, int]] = {}
        for (family, joint), onset in hypothesis.onsets.items():
            onset_ns.setdefault(family, {})[joint] = onset
        return ActiveEffects(self.usual.setting, hypothesis.values, onset_ns)

    def predictor(self, effects: Sequence[MachineEffect]) -> Predictor:
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

    def _confirm(self, effects: list[MachineEffect]) -> ClosedLoop:
        before = LearnedPredictor(self.model, self.parameters)
        of_before = {horizon: self.errors(before, horizon) for horizon in LEVELS}
        self.open_loop = OpenLoopGate(
            before=of_before[80],
            errors=lambda of: self.errors(self.predictor(of), 80),
            refit=lambda of: self._refitted([member for effect in of for member in effect.members]),
            config=self.config.gate,
            say=self.say,
        )
        effects = without_lags_of_one_cause(self.open_loop.passing(effects, self._shows))
        after = self.predictor(effects)
        errors = {
            horizon: (of_before[horizon], self.errors(after, horizon) if effects else of_before[horizon])
            for horizon in LEVELS
        }
        floor = {h: self._on_nominal(before, h) for h in LEVELS}
        self.lap("errors before and after")
        trained = trained_baselines(
            self.model,
            self.parameters,
            self.measured,
            self.purposes,
            self.machine,
            self.config.baselines,
            self.config.seed,
        )
        wrong = wrong_effect(effects, self.search.first)
        rivals = trained if wrong is None else {**trained, "wrong_effect": self.predictor([wrong])}
        baselines = {name: {h: self.errors(of, h).rmse for h in LEVELS} for name, of in rivals.items()}
        on_nominal = {"effects": self._on_nominal(after, 80) if effects else floor[80]}
        on_nominal |= {name: self._on_nominal(of, 80) for name, of in trained.items()}
        self.lap("baselines")
        document = document_of(self, effects, errors, floor, baselines, on_nominal)
        evidence = evidence_of(self, effects, errors, floor, baselines)
        self.lap("evidence")
        return ClosedLoop(document, self._active(effects), evidence)

    def _shows(self, effect: MachineEffect) -> bool:
        """Whether an effect that removes little of the open-loop error shows in a good part of the speeds' residual.

        Of what is seldom met, confirmation rows may show but a moment: on the rows that it was found on.
        """
        if effect.family == SUPPLY:
            return True
        candidates = [member.candidate for member in effect.members]
        share = max(max(c.share, self.judgements[c.key].share) for c in candidates)
        return share > self.config.gate.smallest_share or self._rings(effect)

    def _rings(self, effect: MachineEffect) -> bool:
        """Whether it is a resonance that stops show: of one whose phase is soon lost, no prediction removes much."""
        if effect.family != OSCILLATION:
            return False
        joint, used = effect.joints[0], self.rows.is_used
        return ring_down(self.sequences, used, joint, self.machine.dt_s) is not None

    def _on_nominal(self, of: Predictor, horizon: int) -> np.ndarray:
        """(n_joint,) error on the nominal logs' validation parts: what a correction costs the machine as it was."""
        parts = [validation_part(t) for t in self.nominal]
        return window_errors(of, parts, [np.ones(len(p), bool) for p in parts], horizon).rmse
