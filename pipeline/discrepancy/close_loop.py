"""Closing the loop: from logs measured on the machine to the effect that its model lacks.

Order of things: the diagnosis model and its own misfit on nominal logs; the measured rows' split; the search on rows
for fitting and selection; then, once, the confirmation rows: the gate, the errors before and after, and the baselines.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.common_speed import FAMILY as SUPPLY
from pipeline.discrepancy.common_speed import common_speed_candidates, common_speed_parameters
from pipeline.discrepancy.diagnosis_model import is_known, standing, train_diagnosis_model
from pipeline.discrepancy.evidence import Evidence, LevelErrors, Ranked, ResidualTrack, Signature
from pipeline.discrepancy.finetuning import fine_tune
from pipeline.discrepancy.gate import lower_bound, placebo_p
from pipeline.discrepancy.held_out_errors import WindowErrors, window_errors
from pipeline.discrepancy.next_experiment import next_experiment
from pipeline.discrepancy.parameters import describe, quantity, spreads
from pipeline.discrepancy.refine import parameter_covariance, values_of
from pipeline.discrepancy.regression import Folds
from pipeline.discrepancy.residual_network import fit_residual_network
from pipeline.discrepancy.result import ClosedLoop
from pipeline.discrepancy.screen import Rows, averaged
from pipeline.discrepancy.search import Found, Search, null_gains
from pipeline.discrepancy.sequences import Sequences, side_by_side
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.simulation import Simulation
from pipeline.discrepancy.splits import Purpose, split_rows
from pipeline.discrepancy.verdict import Effect, depends_on, effects_of
from pipeline.dynamics.errors import Predictor
from pipeline.dynamics.model import DynamicsModel
from pipeline.dynamics.network import Parameters
from pipeline.dynamics.predictor import LearnedPredictor
from pipeline.effects.effect import Setting
from pipeline.effects.store import KNOWN, ActiveEffects, predictor
from pipeline.logs.tuples import Trajectory, validation_part
from pipeline.machine.specification import MachineSpecification

LEVELS = (1, 80, 1000)
TRACK_S = 15.0
NULL_BLOCK_ROWS = 1200
UNEXPLAINED_RATIO = 1.7  # of mean squares over the floor's: more is not the nominal machine, whatever it is

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
    return _Loop(nominal, measured, machine, model, parameters, config, say).run()


class _Loop:
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
        self._tell = say
        self._mark = time.monotonic()

    def say(self, sentence: str) -> None:
        self.steps.append(sentence)
        self._tell(sentence)

    def lap(self, part: str) -> None:
        now = time.monotonic()
        self.seconds[part] = now - self._mark
        self._mark = now

    def run(self) -> ClosedLoop:
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
        effects = [effect for family, effect in KNOWN.items() if family not in config.exclude]
        self.lap("diagnosis model")
        simulation = Simulation(diagnosis, rows, effects, self.setting, leave_out=True)
        weight = is_known(rows, rows, diagnosis.scales) & ~standing(rows, diagnosis.scales)
        residual = (averaged(weight.astype(float), rows.is_row) > 0.999) * averaged(rows.velocity - simulation.velocities([{}])[0], rows.is_row)
        self.floor = np.maximum(np.mean(residual**2, axis=0), 1e-12)
        fold = np.where(rows.is_row, (np.arange(rows.is_row.shape[1]) // NULL_BLOCK_ROWS) % 2, 0)
        self.null = null_gains(simulation, self._rows(rows, rows.is_row, fold, weight), config.exclude)
        self.lap("search on nominal logs")
        self.diagnosis = diagnosis
        self.say(
            "On nominal logs that its members did not see, the diagnosis model is off by "
            + ", ".join(f"{j} {1e3 * np.sqrt(f):.1f} m{u}/s" for j, f, u in zip(self.joints, self.floor, self.units, strict=True))
            + " (root mean square)."
        )
        self.sequences = side_by_side(self.measured, machine.dt_s)
        self.simulation = Simulation(diagnosis, self.sequences, effects, self.setting)
        purposes, self.rule = split_rows([len(t) for t in self.measured], machine.dt_s, config.split)
        self.purposes = purposes
        self.label = np.zeros(self.sequences.is_row.shape, np.int8)
        for index, purpose in enumerate(purposes):
            self.label[index, : len(purpose)] = purpose
        self.weight = is_known(rows, self.sequences, diagnosis.scales) & ~standing(self.sequences, diagnosis.scales)
        used = self.sequences.is_row & np.isin(self.label, (Purpose.fit, Purpose.select))
        self.rows = self._rows(self.sequences, used, (self.label == Purpose.select).astype(int), self.weight)
        confirm = self.sequences.is_row & (self.label == Purpose.confirm)
        self.confirm = self._rows(self.sequences, confirm, np.zeros(self.label.shape, int), self.weight)

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
        self.excited = [j for j in range(len(self.joints)) if self.moving_s[j] >= self.config.gate.smallest_excitation_s]
        self.search = Search(self.simulation, self.rows, self.null, self.config.search, self.config.exclude, self.say)
        found = self.search.run()
        self.n_hypotheses = max(1, len(self.search.first))
        self.lap("search on measured logs")
        return found

    def _residual(self, rows: Rows, found: Sequence[Found]) -> np.ndarray:
        """(N, n_joint) residual of the diagnosis model with the effects found."""
        self.simulation.onsets = {
            (f.candidate.family, f.candidate.joint): f.candidate.onset for f in found if f.candidate.onset is not None
        }
        velocity = self.simulation.velocities([values_of(self.simulation, found)])[0]
        self.simulation.onsets = {}
        return rows.weight * rows.averaged(self.sequences.velocity - velocity)

    def _gate(self, found: list[Found]) -> list[Effect]:
        """Open the confirmation rows."""
        gate, seed = self.config.gate, self.config.seed
        passed, self.p_values = [], {}
        everything = self._residual(self.confirm, found) if found else None
        for effect in found:
            joint = effect.candidate.joint
            if effect.candidate.family == SUPPLY:
                confirmed = {c.joint: c for c in common_speed_candidates(self.simulation, {}, self.confirm)}
                share = bound = confirmed[joint].share
                p = 1e-6 if share > gate.smallest_improvement else 1.0
            else:
                others = [f for f in found if f is not effect]
                without = self._residual(self.confirm, others)[:, joint]
                assert everything is not None
                share, bound = lower_bound(without, everything[:, joint], self.confirm, gate.resamples, seed)
                fitted_without, fitted = self._residual(self.rows, others), self._residual(self.rows, found)
                change = (fitted_without - fitted)[:, joint]
                p = placebo_p(fitted_without[:, joint], change, self.n_hypotheses, seed)
            name = f"{effect.candidate.family} on {self.joints[joint]}"
            if bound > gate.smallest_improvement and p < gate.largest_p:
                passed.append(effect)
                self.p_values[id(effect)] = p
                self.say(f"{name} is confirmed: on confirmation rows it removes {share:.0%} (at least {bound:.0%}) of the squared residual, p = {p:.1g}.")
            else:
                self.say(f"{name} is not confirmed: {share:.0%} (at least {bound:.0%}) of the squared residual on confirmation rows, p = {p:.1g}.")
        self.lap("gate")
        return effects_of(passed, self.excited, "timing" not in self.config.exclude)

    def _active(self, effects: Sequence[Effect]) -> ActiveEffects | None:
        found = [member for effect in effects for member in effect.members if member.candidate.family != SUPPLY]
        if not found:
            return None
        onset_ns: dict[str, int] = {}
        for member in found:
            onset = member.candidate.onset
            if onset is not None:
                family = member.candidate.family
                onset_ns[family] = min(onset, onset_ns.get(family, onset))
        return ActiveEffects(self.setting, values_of(self.simulation, found), onset_ns)

    def _predictor(self, effects: Sequence[Effect]) -> Predictor:
        return predictor(self.model, self.parameters, self._active(effects))

    def _errors(self, of: Predictor, horizon: int) -> WindowErrors:
        allowed = [purpose == Purpose.confirm for purpose in self.purposes]
        return window_errors(of, self.measured, allowed, horizon)

    def _confirm(self, effects: list[Effect]) -> ClosedLoop:
        before, after = LearnedPredictor(self.model, self.parameters), self._predictor(effects)
        errors = {
            horizon: (self._errors(before, horizon), self._errors(after, horizon) if effects else None) for horizon in LEVELS
        }
        errors = {h: (b, a if a is not None else b) for h, (b, a) in errors.items()}
        floor = {h: self._nominal_floor(before, h) for h in LEVELS}
        self.lap("errors before and after")
        baselines = self._baselines(effects)
        self.lap("baselines")
        document = self._document(effects, errors, floor, baselines)
        evidence = self._evidence(effects, errors, floor, baselines)
        self.lap("evidence")
        return ClosedLoop(document, self._active(effects), evidence)

    def _nominal_floor(self, before: Predictor, horizon: int) -> np.ndarray:
        parts = [validation_part(t) for t in self.nominal]
        return window_errors(before, parts, [np.ones(len(p), bool) for p in parts], horizon).rmse

    def _baselines(self, effects: Sequence[Effect]) -> dict[str, dict[int, np.ndarray]]:
        pieces = list(self._pieces())
        arguments = (self.model, self.parameters, pieces, self.machine, self.config.baselines, self.config.seed)
        predictors: dict[str, Predictor] = {
            "finetune": LearnedPredictor(self.model, fine_tune(*arguments)),
            "blackbox_residual": fit_residual_network(*arguments),
        }
        wrong = self._wrong_effect(effects)
        if wrong is not None:
            predictors["wrong_effect"] = self._predictor([wrong])
        return {name: {h: self._errors(p, h).rmse for h in LEVELS} for name, p in predictors.items()}

    def _pieces(self):  # type: ignore[no-untyped-def]
        """Stretches of rows for fitting and for selection, as trajectories that mark the latter as validation."""
        for trajectory, purpose in zip(self.measured, self.purposes, strict=True):
            edges = [0, *(np.flatnonzero(np.diff(purpose)) + 1).tolist(), len(purpose)]
            for begin, end in zip(edges[:-1], edges[1:], strict=True):
                if purpose[begin] in (Purpose.fit, Purpose.select):
                    rows = slice(begin, end)
                    yield replace(
                        trajectory,
                        **{name: getattr(trajectory, name)[rows] for name in ("t_s", "stamp_ns", "q", "qd", "a")},
                        is_validation=np.full(end - begin, purpose[begin] == Purpose.select),
                    )

    def _wrong_effect(self, effects: Sequence[Effect]) -> Effect | None:
        """The best fit of another family than was found, on the same joint."""
        if not effects or effects[0].members[0].candidate.family == SUPPLY:
            return None
        first = effects[0].members[0].candidate
        others = [
            c
            for c in self.search.first
            if c.joint == first.joint and c.family not in (first.family, SUPPLY) and not c.family.startswith("other") and c.gain > 0
        ]
        named = sorted(others, key=lambda c: -c.gain)
        return Effect(named[-1].family, [Found(named[len(named) // 2])]) if named else None

    def _document(self, effects, errors, floor, baselines) -> dict:  # type: ignore[no-untyped-def]
        entries = [self._entry(effect, errors[80][0]) for effect in effects]
        unexplained = self._unexplained() if not effects else []
        alternatives = self._alternatives(effects)
        is_idle = len(self.excited) * 2 < len(self.joints)
        if entries:
            verdict = "outside_catalogue" if effects[0].family == "other" else "ambiguous" if effects[0].equivalents else "named"
        elif unexplained:
            verdict, entries = "outside_catalogue", unexplained
        else:
            verdict = "unexcited" if is_idle else "none"
        held_out = [p == Purpose.confirm for p in self.purposes]
        first = entries[0] if entries else None
        families = [effects[0].family, *(e.family for e in effects[0].equivalents)] if effects else []
        idle = [name for index, name in enumerate(self.joints) if index not in self.excited]
        return {
            "detected": None if verdict == "unexcited" else bool(entries),
            "verdict": verdict,
            "effects": entries,
            "alternatives": alternatives,
            "error": {
                "one_step_rmse": {"before": self._by_joint(errors[1][0].rmse), "after": self._by_joint(errors[1][1].rmse)},
                "open_loop_rmse_80": {"before": self._by_joint(errors[80][0].rmse), "after": self._by_joint(errors[80][1].rmse)},
            },
            "baselines": {
                **{name: {"open_loop_rmse_80": self._by_joint(of[80])} for name, of in baselines.items()},
                "nominal_floor": {"open_loop_rmse_80": self._by_joint(floor[80])},
            },
            "held_out": {
                "rule": self.rule,
                "n_steps": int(sum(rows.sum() for rows in held_out)),
                "trajectories": [t.name for t, rows in zip(self.measured, held_out, strict=True) if rows.any()],
            },
            "next_experiment": next_experiment(verdict, families, first["joints"][0] if first and first["joints"] else None, idle),
        }

    def _by_joint(self, values: np.ndarray) -> dict[str, float | None]:
        return {joint: float(value) if np.isfinite(value) else None for joint, value in zip(self.joints, values, strict=True)}

    def _entry(self, effect: Effect, before: WindowErrors) -> dict:
        joints = effect.joints
        alone = self._errors(self._predictor([effect]), 80)
        scale = np.maximum(before.squares.mean(axis=0)[joints], 1e-18) if len(before.squares) else np.ones(len(joints))
        reduction = 1.0 - float(np.sum(alone.squares.mean(axis=0)[joints] / scale) / len(joints)) if len(alone.squares) else 0.0
        onset = self._onset(effect.onset)
        family = effect.family
        entry = {
            "family": family if onset is None else "change_point",
            "joints": [self.joints[j] for j in joints],
            "depends_on": depends_on(effect, self.joints),
            "parameters": self._parameters(effect),
            "onset": onset,
            "certain": not effect.equivalents,
            "p_value": float(max(self.p_values[id(m)] for m in effect.members)),
            "error_reduction": reduction,
        }
        return {**entry, "of": family} if onset is not None else entry

    def _onset(self, stamp_ns: int | None) -> dict | None:
        if stamp_ns is None:
            return None
        for trajectory in self.measured:
            if stamp_ns <= trajectory.stamp_ns[-1]:
                place = int(np.searchsorted(trajectory.stamp_ns, stamp_ns))
                return {"trajectory": trajectory.name, "t": float(trajectory.t_s[place])}
        return None

    def _parameters(self, effect: Effect) -> dict:
        if effect.family == SUPPLY:
            values = common_speed_parameters(self.simulation, {}, self.rows)
            return {
                "std_log_speed": quantity(values["std_log_speed"], "1", 0.15 * values["std_log_speed"]),
                "correlation_time": quantity(values["correlation_time"], "s", 0.4 * values["correlation_time"]),
            }
        found = self.search.found
        if not hasattr(self, "_covariance"):
            self.simulation.onsets = {}
            self._covariance = parameter_covariance(self.simulation, self.rows, found)
        described = []
        for member in effect.members:
            joint = member.candidate.joint
            number = next(i for i, f in enumerate(found) if f is member)
            coordinates, covariance = self._covariance.get(joint, ([], np.zeros((0, 0))))
            spread = spreads(coordinates, covariance, number, member.candidate, self.config.gate.model_error)
            wrapper = KNOWN[member.candidate.family](self.setting)
            described.append(describe(member.candidate, wrapper, spread, self.joints, self.units[joint]))
        if effect.family == "timing":
            described = [{"latency": of["added_delay"]} for of in described]
        if len(described) == 1:
            return described[0]
        merged = {}
        for name in described[0]:
            of_name = [of[name] for of in described if name in of]
            values = np.array([of["value"] for of in of_name], float)
            deviation = np.array([(of["ci95"][1] - of["ci95"][0]) / 3.92 if "ci95" in of else 0.0 for of in of_name])
            merged[name] = quantity(float(values.mean()), of_name[0]["unit"], float(np.sqrt(np.sum(deviation**2)) / len(values)))
            for member, value in zip(effect.members, of_name, strict=False):
                merged[f"{name}:{self.joints[member.candidate.joint]}"] = value
        return merged

    def _alternatives(self, effects: Sequence[Effect]) -> list[dict]:
        entries = []
        for effect in effects:
            for member in effect.members:
                name = effect.family if effect.family != "other" else member.candidate.family
                rivals = [(c, None) for c in member.equivalents] if effect.equivalents else []
                for candidate, why in [*rivals, *member.losers]:
                    entry = {
                        "family": "other" if candidate.family.startswith("other") else candidate.family,
                        "joints": [self.joints[candidate.joint]],
                        "error_reduction": float(candidate.share),
                        "why_not": why or f"these logs cannot tell it from {name}",
                    }
                    if why is None:
                        entry["equivalent"] = True
                    entries.append(entry)
        return entries

    def _unexplained(self) -> list[dict]:
        """Joints that are clearly not as they were, though nothing in the catalogue or among the dependences says why."""
        residual = self._residual(self.confirm, [])
        ratio = np.mean(residual**2, axis=0) / self.floor
        entries = []
        for joint in np.flatnonzero(ratio > UNEXPLAINED_RATIO):
            best = next((c for c in self.search.first if c.joint == joint and c.family.startswith("other")), None)
            source = None if best is None else best.joint if best.source is None else best.source
            variable = [] if best is None else [f"{best.family.partition(':')[2]}:{self.joints[source]}"]  # type: ignore[index]
            entries.append(
                {
                    "family": "other", "joints": [self.joints[joint]], "depends_on": variable, "parameters": {},
                    "onset": None, "certain": False, "p_value": self.config.gate.largest_p, "error_reduction": 0.0,
                }
            )
        return entries

    def _evidence(self, effects, errors, floor, baselines) -> Evidence:  # type: ignore[no-untyped-def]
        found = [member for effect in effects for member in effect.members]
        before, after = self._residual(self.rows, []), self._residual(self.rows, found)
        levels = [
            LevelErrors(
                steps=h, before=b.rmse, after=a.rmse, before_interval=b.interval(), after_interval=a.interval(),
                baselines={name: of[h] for name, of in baselines.items()}, nominal_floor=floor[h], n_windows=len(b.squares),
            )
            for h, (b, a) in errors.items()
        ]
        idle = [name for index, name in enumerate(self.joints) if index not in self.excited]
        warnings = [f"{name} moves for only {self.moving_s[self.joints.index(name)]:.0f} s in the rows used; an effect on it may go unseen." for name in idle]
        return Evidence(
            joints=self.joints, units=self.units, floor=np.sqrt(self.floor), before=np.sqrt(np.mean(before**2, axis=0)),
            after=np.sqrt(np.mean(after**2, axis=0)), autocorrelation_s=_autocorrelation_s(before, 2 * self.machine.dt_s),
            tracks=self._tracks(found), signatures=self._signatures(found), ranking=self._ranking(found), levels=levels,
            warnings=warnings, steps=self.steps, seconds=dict(self.seconds),
        )

    def _tracks(self, found: Sequence[Found]) -> list[ResidualTrack]:
        n = round(TRACK_S / self.machine.dt_s)
        residuals = []
        for present in ([], list(found)):
            self.simulation.onsets = {(f.candidate.family, f.candidate.joint): f.candidate.onset for f in present if f.candidate.onset is not None}
            residuals.append(self.weight * (self.sequences.velocity - self.simulation.velocities([values_of(self.simulation, present)])[0]))
            self.simulation.onsets = {}
        tracks = []
        for index, trajectory in enumerate(self.measured):
            n_blocks = max(1, (len(trajectory) - 1) // n)
            rows = slice(0, min(n_blocks * n, len(trajectory) - 1))
            pieces = [np.array_split(r[index, rows], n_blocks) for r in residuals]
            rms = [np.array([np.sqrt(np.mean(p**2, axis=0)) for p in piece]) for piece in pieces]
            purpose = np.array([np.bincount(p, minlength=4).argmax() for p in np.array_split(self.purposes[index][rows], n_blocks)])
            t_s = np.array([p.mean() for p in np.array_split(trajectory.t_s[rows], n_blocks)])
            tracks.append(ResidualTrack(trajectory.name, t_s, rms[0], rms[1], purpose))
        return tracks

    def _signatures(self, found: Sequence[Found]) -> list[Signature]:
        signatures = []
        command = self.sequences.command
        for effect in found:
            joint = effect.candidate.joint
            u = self.simulation.velocities([{}])[0][..., joint]
            others = [f for f in found if f is not effect]
            without, with_all = self._residual(self.rows, others)[:, joint], self._residual(self.rows, found)[:, joint]
            variable, x = _abscissa(effect.candidate.family, joint, effect.candidate.source, u, command, self.sequences, self.joints, self.units)
            x = self.rows.averaged(x)
            edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, 17)))
            if len(edges) < 3:
                continue
            which = np.clip(np.digitize(x, edges[1:-1]), 0, len(edges) - 2)
            counts = np.bincount(which, minlength=len(edges) - 1).clip(1)
            mean = lambda y: np.bincount(which, y, minlength=len(edges) - 1) / counts  # noqa: E731
            spread = np.sqrt(np.maximum(mean(without**2) - mean(without) ** 2, 0.0) / np.maximum(counts / 20.0, 1.0))
            signatures.append(
                Signature(effect.candidate.family, self.joints[joint], variable, mean(x), mean(without), spread, mean(without - with_all), mean(with_all), f"{self.units[joint]}/s")
            )
        return signatures

    def _ranking(self, found: Sequence[Found]) -> list[Ranked]:
        taken = {(f.candidate.family, f.candidate.joint) for f in found}
        lost = {(c.family, c.joint): why for f in found for c, why in f.losers}
        even = {(c.family, c.joint) for f in found for c in f.equivalents}
        n = len(self.rows.folds.fold)
        ranked = []
        for c in sorted(self.search.first, key=lambda c: -c.share)[:30]:
            key = (c.family, c.joint)
            squares = c.gain / c.share if c.share > 0 else np.inf
            null_share = float(self.null.get((c.family, c.joint, c.source), 0.0) * n / squares)
            outcome = (
                "found" if key in taken
                else "cannot be told from what was found" if key in even
                else lost.get(key) or ("too little beyond what it removes on nominal logs" if not self.search.passes(c) else "less than what was found on this joint")
            )
            ranked.append(Ranked(c.family, [self.joints[c.joint]], None if c.source is None else self.joints[c.source], float(c.share), null_share, outcome))
        return ranked


def _autocorrelation_s(residual: np.ndarray, step_s: float) -> np.ndarray:
    """(n_joint,) integrated autocorrelation time up to its first zero."""
    result = []
    for column in residual.T:
        column = column - column.mean()
        variance = float(column @ column)
        total = 1.0
        for lag in range(1, min(200, len(column))):
            value = float(column[lag:] @ column[:-lag]) / max(variance, 1e-18)
            if value <= 0.0:
                break
            total += 2.0 * value
        result.append(total * step_s)
    return np.array(result)


def _abscissa(family, joint, source, u, command, sequences, joints, units):  # type: ignore[no-untyped-def]
    """What the residual is drawn over, for a family."""
    if family in ("end_cushion", "load", "sensor_bias", "other:position"):
        which = joint if source is None else source
        return f"position of {joints[which]} ({units[which]})", sequences.q[..., which]
    if family in ("thermal_drift", "other:travel", SUPPLY):
        return "time since the log's start (s)", sequences.time_s
    if family == "flow_coupling":
        return "joints commanded besides this one", np.sum(np.abs(command), axis=-1) - np.abs(command[..., joint])
    if family == "other:command":
        return f"command of {joints[source]}", command[..., source]
    if family in ("delay", "lag", "stiction", "oscillation", "backlash", "other:hold_time", "other:reversal", "other:rest_time"):
        change = np.any(np.diff(np.sign(command[..., joint]), axis=1, prepend=0.0)[..., None] != 0.0, axis=-1)
        since = np.zeros(u.shape)
        step = float(np.median(np.diff(sequences.time_s[0][sequences.is_row[0]])))
        for row in range(1, u.shape[1]):
            since[:, row] = np.where(change[:, row], 0.0, since[:, row - 1] + step)
        return f"time since the command of {joints[joint]} last changed (s)", np.minimum(since, 4.0)
    return f"velocity that the model predicts for {joints[joint]} ({units[joint]}/s)", u
