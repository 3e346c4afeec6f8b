"""iCEM, one decision at a time (Pinneri et al., Algorithm 1; the paper, "MPC-based controller").

The problem: maximise Σ_k γ^k r_{t+k} over commands a_{t:t+H-1}, with the learned model from the measured history on.
The search is over continuous proto-actions in [-1, 1], which are discretised only to be rolled out; mean, standard
deviation, elites and their reuse are all over proto-actions, as the paper's text has it.
"""

from collections.abc import Callable
from functools import partial
from itertools import groupby
from typing import NamedTuple

import jax
import jax.numpy as jnp

from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.noise import coloured_noise, synthesis_matrix
from pipeline.control.icem.proposal import Proposal, refit, sample_within_bounds, shift
from pipeline.control.icem.returns import SequenceReturns
from pipeline.reaching.task import TaskState


class RankedPlans(NamedTuple):
    """Sequences with their returns, best first.

    Attributes:
        proto: (K, H, n_joint), in [-1, 1].
        returns: (K,); -inf for a place that no sequence holds yet.
    """

    proto: jax.Array
    returns: jax.Array


class PlannerState(NamedTuple):
    """What the planner knows between two decisions.

    Attributes:
        key: of the next decision's random numbers.
        proposal: that the next decision begins with, already moved on in time.
        elites: of the last decision, not yet moved on; empty places at the start of an episode.
    """

    key: jax.Array
    proposal: Proposal
    elites: RankedPlans


class Planner:
    """Pure functions of explicit state, for one machine at a time; use `vmap` for several."""

    def __init__(
        self,
        config: IcemConfig,
        returns: SequenceReturns,
        command: Callable[[jax.Array], jax.Array],
        n_joint: int,
        entries_per_decision: int,
    ) -> None:
        """Puts the parts together.

        Args:
            config: budget and ingredients.
            returns: what sequences of commands are worth.
            command: from proto-actions to commands, any leading axes.
            n_joint: dimension of an action.
            entries_per_decision: by how many entries sequences move on from one decision to the next.
        """
        self._config = config
        self._returns = returns
        self._command = command
        self._n_joint = n_joint
        self._entries_per_decision = entries_per_decision
        self._synthesis = jnp.asarray(synthesis_matrix(config.horizon, config.noise_exponent), jnp.float32)

    def begin(self, key: jax.Array) -> PlannerState:
        """State at the start of an episode: mean zero, σ_0, no elites; `key` is kept."""
        config = self._config
        shape = (config.horizon, self._n_joint)
        return PlannerState(
            key,
            Proposal(jnp.zeros(shape), jnp.full(shape, config.initial_std, jnp.float32)),
            RankedPlans(jnp.zeros((config.elites, *shape)), jnp.full(config.elites, -jnp.inf, jnp.float32)),
        )

    def decide(self, state: PlannerState, measured: TaskState) -> tuple[PlannerState, jax.Array]:
        """Plan from what is measured, and take the first command of the plan.

        Args:
            state: of the planner.
            measured: of the task, without batch axes.

        Returns:
            The planner's next state, and the command (n_joint,).
        """
        key, iterations_key = jax.random.split(state.key)
        proposal, elites = self.optimise(iterations_key, state.proposal, state.elites, measured)
        first = elites.proto[0, 0] if self._config.execute_best else proposal.mean[0]
        return PlannerState(key, self._next(proposal), elites), self._command(first)

    def optimise(
        self, key: jax.Array, proposal: Proposal, previous: RankedPlans, measured: TaskState
    ) -> tuple[Proposal, RankedPlans]:
        """All iterations of one decision.

        Args:
            key: of the random numbers; consumed.
            proposal: to begin with.
            previous: elites of the last decision, not yet moved on.
            measured: state to plan from.

        Returns:
            The proposal after the last iteration, and the last iteration's elites.
        """
        config = self._config
        keys = jax.random.split(key, config.iterations)
        last = config.iterations - 1

        def iterate(
            n: int, carry: tuple[Proposal, RankedPlans], at: tuple[jax.Array, jax.Array]
        ) -> tuple[tuple[Proposal, RankedPlans], None]:
            (proposal, kept), (iteration, key) = carry, at
            proto = self._sample(key, proposal, n)
            if config.mean_in_last_iteration:
                proto = proto.at[0].set(jnp.where(iteration == last, proposal.mean, proto[0]))
            candidates = self._rank(measured, proto)
            if config.keep_elites:
                candidates = _joined(candidates, _first(kept, config.n_reused))
            elites = _best(candidates, config.elites)
            return (refit(proposal, elites.proto, config.momentum), elites), None

        # The first iteration, with elites of the last decision in place of those of the last iteration
        first_key, shift_key = jax.random.split(keys[0])
        proto = self._sample(first_key, proposal, config.sample_counts[0])
        if config.mean_in_last_iteration and last == 0:
            proto = proto.at[0].set(proposal.mean)
        if config.shift_elites:
            shifted = self._shifted(shift_key, proposal, _first(previous, config.n_reused))
            there = jnp.concatenate([jnp.ones(len(proto), bool), jnp.isfinite(shifted.returns)])
            candidates = self._rank(measured, jnp.concatenate([proto, shifted.proto]))
            candidates = candidates._replace(returns=jnp.where(there, candidates.returns, -jnp.inf))
        else:
            candidates = self._rank(measured, proto)
        elites = _best(candidates, config.elites)
        carry = refit(proposal, elites.proto, config.momentum), elites

        # Then runs of iterations with equally many samples, each compiled once
        iteration = 1
        for n, run in groupby(config.sample_counts[1:]):
            end = iteration + len(list(run))
            at = (jnp.arange(iteration, end), keys[iteration:end])
            carry, _ = jax.lax.scan(partial(iterate, n), carry, at)
            iteration = end
        return carry

    def _sample(self, key: jax.Array, proposal: Proposal, n: int) -> jax.Array:
        noise = coloured_noise(key, self._synthesis, n, self._n_joint)
        return sample_within_bounds(proposal, noise, self._config.bounds)

    def _rank(self, measured: TaskState, proto: jax.Array) -> RankedPlans:
        """The sequences with their returns, in the order given; one that the model loses itself in is worth -inf."""
        returns = self._returns(measured, self._command(proto))
        return RankedPlans(proto, jnp.where(jnp.isnan(returns), -jnp.inf, returns))

    def _shifted(self, key: jax.Array, proposal: Proposal, elites: RankedPlans) -> RankedPlans:
        """Elites moved on in time, their last entries sampled anew; with the returns that they had."""
        n = self._entries_per_decision
        fresh = self._sample(key, proposal, len(elites.proto))
        return elites._replace(proto=shift(elites.proto, n, fresh[:, -n:]))

    def _next(self, proposal: Proposal) -> Proposal:
        """The proposal of the next decision: the mean moved on, its last entry repeated; σ_0."""
        config, n = self._config, self._entries_per_decision
        mean, std = proposal
        initial = jnp.full_like(std, config.initial_std)
        return Proposal(
            shift(mean, n, mean[-1:]) if config.shift_mean else jnp.zeros_like(mean),
            initial if config.reset_std else shift(std, n, initial[:n]),
        )


def _best(ranked: RankedPlans, n: int) -> RankedPlans:
    returns, index = jax.lax.top_k(ranked.returns, n)
    return RankedPlans(ranked.proto[index], returns)


def _first(ranked: RankedPlans, n: int) -> RankedPlans:
    return RankedPlans(ranked.proto[:n], ranked.returns[:n])


def _joined(a: RankedPlans, b: RankedPlans) -> RankedPlans:
    return RankedPlans(jnp.concatenate([a.proto, b.proto]), jnp.concatenate([a.returns, b.returns]))
