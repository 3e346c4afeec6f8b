"""Section `icem` of a profile."""

import enum
from dataclasses import dataclass

from pipeline.errors import InputError


class Bounds(enum.StrEnum):
    """How proto-actions are kept in [-1, 1]."""

    clip = "clip"  # as published: what exceeds the bounds lies on them
    truncate = "truncate"  # ablation: the Gaussian is cut off at the bounds, as in earlier planners


@dataclass
class IcemConfig:
    """Budget and ingredients of the planner; each ingredient can be switched off alone.

    Attributes:
        horizon: H_MPC, entries of a command sequence.
        held_entries: whether an entry is held for `control.action_repeats` ticks, or is a single tick.
        samples: N_pop, sequences sampled in the first iteration.
        elites: N_e, best sequences that the distribution is fitted to.
        iterations: K, of optimisation per decision.
        initial_std: σ_0, of proto-actions.
        discount: γ of Eq. mpc_objective, per entry.
        noise_exponent: β, power spectrum f^-β of the noise along the horizon; 0: white noise.
        sample_decay: from one iteration to the next the number of samples is divided by it, but never below
            twice `elites`; 1: no decay.
        momentum: α, share of the old mean and standard deviation in the new ones; 0: none.
        elite_fraction: share of the elites, best first, that `keep_elites` and `shift_elites` reuse.
        keep_elites: elites compete again in the next iteration.
        shift_elites: elites of the last decision, moved on in time, compete in the first iteration.
        shift_mean: the mean of the last decision, moved on in time, is the first mean; else zero is.
        mean_in_last_iteration: the mean takes the place of one sample in the last iteration.
        reset_std: every decision begins with σ_0; else with the last decision's, moved on in time.
        execute_best: the first entry of the best sequence is executed; else that of the mean.
        bounds: clip or truncate.
        first_episodes: how many of the fixed episodes are evaluated; null: all.
        chunk_episodes: episodes evaluated at once, and the unit that a killed evaluation resumes by.
    """

    horizon: int
    held_entries: bool
    samples: int
    elites: int
    iterations: int
    initial_std: float
    discount: float
    noise_exponent: float
    sample_decay: float
    momentum: float
    elite_fraction: float
    keep_elites: bool
    shift_elites: bool
    shift_mean: bool
    mean_in_last_iteration: bool
    reset_std: bool
    execute_best: bool
    bounds: Bounds
    first_episodes: int | None
    chunk_episodes: int

    def __post_init__(self) -> None:
        self.bounds = Bounds(self.bounds)
        for name in ("samples", "iterations", "chunk_episodes"):
            if getattr(self, name) < 1:
                raise InputError(f"icem.{name} is {getattr(self, name)}; it must be at least 1")
        if self.first_episodes is not None and self.first_episodes < 1:
            raise InputError(
                f"icem.first_episodes is {self.first_episodes}; give at least 1, or null for all"
            )
        if self.horizon < 2:
            raise InputError(f"icem.horizon is {self.horizon}; it must be at least 2")
        if not 2 <= self.elites <= self.samples:
            raise InputError(
                f"icem.elites is {self.elites}; it must be at least 2 and not above icem.samples ({self.samples})"
            )
        if not self.initial_std > 0:
            raise InputError(f"icem.initial_std is {self.initial_std}; it must be positive")
        if not self.noise_exponent >= 0:
            raise InputError(f"icem.noise_exponent is {self.noise_exponent}; it must not be negative")
        if not self.sample_decay >= 1:
            raise InputError(f"icem.sample_decay is {self.sample_decay}; it must be at least 1 (no decay)")
        for name in ("discount", "elite_fraction"):
            if not 0 < getattr(self, name) <= 1:
                raise InputError(f"icem.{name} is {getattr(self, name)}; it must be in (0, 1]")
        if not 0 <= self.momentum < 1:
            raise InputError(f"icem.momentum is {self.momentum}; it must be in [0, 1)")

    @property
    def sample_counts(self) -> list[int]:
        """N_i per iteration: max(N_pop γ^-i, 2 N_e) (Pinneri et al., Algorithm 1), and never above N_pop."""
        return [
            min(self.samples, max(int(self.samples / self.sample_decay**iteration), 2 * self.elites))
            for iteration in range(self.iterations)
        ]

    @property
    def n_reused(self) -> int:
        """Number of elites that are kept or shifted."""
        return max(1, int(self.elite_fraction * self.elites))

    def ticks_per_entry(self, action_repeats: int) -> int:
        """Ticks that the dynamics takes per entry of a sequence."""
        return action_repeats if self.held_entries else 1

    def model_steps(self, action_repeats: int) -> int:
        """Steps of the dynamics that a decision takes, over all its sequences."""
        return self.sequences_per_decision * self.horizon * self.ticks_per_entry(action_repeats)

    def entries_per_decision(self, action_repeats: int) -> int:
        """By how many entries sequences move on from one decision, of `action_repeats` ticks, to the next.

        Raises:
            InputError: that is more than the horizon.
        """
        entries = action_repeats // self.ticks_per_entry(action_repeats)
        if entries >= self.horizon:
            raise InputError(
                f"icem.horizon is {self.horizon}; with control.action_repeats {action_repeats} it must be "
                f"above {entries}"
            )
        return entries

    @property
    def sequences_per_decision(self) -> int:
        """Sequences that are rolled out per decision, but for the first of an episode, which has no elites yet."""
        return sum(self.sample_counts) + (self.n_reused if self.shift_elites else 0)
