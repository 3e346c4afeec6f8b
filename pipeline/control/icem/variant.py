"""The three rewards that the paper plans with (table of evaluation results)."""

import dataclasses
import enum

from pipeline.errors import InputError
from pipeline.reaching.reward import RewardConfig, RewardTerm


class RewardVariant(enum.StrEnum):
    """iCEM, iCEM† and iCEM‡."""

    icem = "icem"
    icem_dagger = "icem_dagger"
    icem_double_dagger = "icem_double_dagger"


LEFT_OUT = {
    RewardVariant.icem: frozenset[RewardTerm](),
    RewardVariant.icem_dagger: frozenset({RewardTerm.precision}),  # r^epsilon = 0
    RewardVariant.icem_double_dagger: frozenset({RewardTerm.precision, RewardTerm.pose}),  # and r^X = 0
}


def variant_reward(reward: RewardConfig, variant: RewardVariant) -> RewardConfig:
    """The reward without the terms that the variant leaves out.

    Raises:
        InputError: nothing is left.
    """
    terms = [term for term in reward.terms if term not in LEFT_OUT[variant]]
    if not terms:
        raise InputError(f"variant={variant}: leaves no term of reward.terms; list another one there")
    return dataclasses.replace(reward, terms=terms)
