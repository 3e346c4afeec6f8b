"""What effects do to predictions over 80 steps on confirmation rows: none may do harm, and what is named shows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.acceptance.gate import GateConfig
from pipeline.discrepancy.acceptance.held_out_errors import WindowErrors
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.effects.catalogue import KNOWN


@dataclass(frozen=True)
class OpenLoopGate:
    """The gate.

    Known effects of the given model pass.

    Attributes:
        before: Errors of the frozen model with known effects.
        errors: Of the model with effects.
        refit: Effects with values that no longer make room for what was dropped.
        config: Thresholds.
        log: Called with a sentence per effect that is dropped.
        known: Effects of the given model, which `before` has.
    """

    before: WindowErrors
    errors: Callable[[Sequence[MachineEffect]], WindowErrors]
    refit: Callable[[Sequence[MachineEffect]], FittedEffects]
    config: GateConfig
    log: Callable[[str], None]
    known: Sequence[MachineEffect] = ()

    def passing(self, fit: FittedEffects, shows_otherwise: Callable[[MachineEffect], bool]) -> FittedEffects:
        """Effects that do no harm and are worth a name, all beside one another.

        Args:
            shows_otherwise: Whether the strongest, where it hardly moves positions, shows all the same.
        """
        while True:
            harmless = self.without_harm(fit)
            fit = self.worth_a_name(harmless, shows_otherwise)
            if fit is harmless:
                return fit  # what stays has not been refitted since it was tried

    def without_harm(self, fit: FittedEffects) -> FittedEffects:
        """Drop the weakest effect of a joint whose error rises beyond the margin, until none does."""
        while effects := fit.effects:
            worse = self._worse(effects)
            suspects = [e for e in reversed(effects) if _may_harm(e, worse) and not e.is_known]
            if not worse or not suspects:
                break
            # The weakest whose absence restores the joints; where none does by itself, the weakest.
            without = {id(suspect): _without(effects, suspect, worse) for suspect in suspects}
            cures = (s for s in suspects if not worse & self._worse(without[id(s)]))
            guilty = next(cures, suspects[0]) if len(suspects) > 1 else suspects[0]
            is_spared_in_part = len(without[id(guilty)]) == len(effects)
            fit = self.refit(without[id(guilty)])
            self.log(
                f"{guilty.family} is dropped"
                + (" on some joints" if is_spared_in_part else "")
                + ": it makes the open-loop error of a joint larger."
            )
        return fit

    def _worse(self, effects: Sequence[MachineEffect]) -> set[int]:
        """Joints whose error rises beyond the margin, and by more than blocks differ by chance."""
        errors = self.errors(effects)
        is_beyond = errors.rmse > self.before.rmse * (1.0 + self.config.worse_margin)
        if not is_beyond.any():
            return set()
        most = np.quantile(errors.improvement(self.before), self.config.confidence, axis=0)
        return set(np.flatnonzero(is_beyond & (most < 0.0)).tolist())

    def error_reduction(self, effect: MachineEffect) -> float:
        """Share of the squared error that an effect removes by itself, its joints scaled alike."""
        joints = effect.joints
        alone = self.errors([*self.known, effect])
        if not len(alone.squares) or not len(self.before.squares):
            return 0.0
        scale = np.maximum(self.before.squares.mean(axis=0)[joints], 1e-18)
        return 1.0 - float(np.sum(alone.squares.mean(axis=0)[joints] / scale) / len(joints))

    def worth_a_name(
        self, fit: FittedEffects, shows_otherwise: Callable[[MachineEffect], bool]
    ) -> FittedEffects:
        """Effects that show: in the prediction or, the first and those that predict nothing, otherwise.

        Args:
            shows_otherwise: Whether one that hardly moves positions, or predicts nothing, shows all the same.
        """
        kept = [effect for effect in fit.effects if effect.is_known]
        for number, effect in enumerate(e for e in fit.effects if not e.is_known):
            reduction = self.error_reduction(effect)
            is_shown = (number == 0 or not effect.has_wrapper) and shows_otherwise(effect)
            if reduction < self.config.smallest_error_reduction and not is_shown:
                self.log(f"{effect.family} is not named: it removes {reduction:.0%} of the open-loop error.")
            else:
                kept.append(effect)
        return fit if len(kept) == len(fit.effects) else self.refit(kept)


def _may_harm(effect: MachineEffect, joints: set[int]) -> bool:
    if not effect.has_wrapper:
        return False
    reaches = any(KNOWN[m.candidate.family].reaches_other_joints for m in effect.members)
    return reaches or bool(set(effect.joints) & joints)


def _without(effects: Sequence[MachineEffect], guilty: MachineEffect, worse: set[int]) -> list[MachineEffect]:
    """The effects without one; of one cause on several joints, its part on joints that are not worse stays."""
    spared = [m for m in guilty.members if m.candidate.joint not in worse]
    is_spared = guilty.can_lose_joints and 0 < len(spared) < len(guilty.members)
    rest = [MachineEffect(guilty.family, spared)] if is_spared else []
    return [part for e in effects for part in (rest if e is guilty else [e])]
