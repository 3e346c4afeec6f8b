"""Every card is complete, and the contract's families are there."""

import pytest

from pipeline.effects.catalogue import BEYOND_THE_CONTRACT, CATALOGUE, KNOWN, families
from pipeline.effects.dependence import DEPENDENCES
from pipeline.effects.effect import Place, Scope

from .conftest import SETTING

# The contract's table (section 4), with the parameters that it names.
CONTRACT = {
    "gain", "delay", "lag", "flow_coupling", "load", "thermal_drift", "supply_variation", "leakage", "backlash",
    "stiction", "end_cushion", "sensor_bias", "timing", "oscillation", "change_point", "other",
}  # fmt: skip
WITHOUT_WRAPPER = {
    "supply_variation",
    "change_point",
    "other",
}  # latent, an onset of others, one per variable
VARIABLES = {
    "command", "command_history", "hold_time", "direction", "position", "velocity", "reversal", "rest_time",
    "time_since_start", "time_since_stop", "absolute_time", "activity", "travel", "zero_command", "clock", "random",
    "latent", "channel",
}  # fmt: skip
UNITS = {"1", "s", "Hz", "sign", "length", "speed"}


def test_the_contracts_families_are_covered():
    assert set(CATALOGUE) == CONTRACT - WITHOUT_WRAPPER
    assert all(family.startswith("other:") for family in (*DEPENDENCES, *BEYOND_THE_CONTRACT))
    assert all(of.card.depends_on == (of.variable,) for of in DEPENDENCES.values())


def test_families_can_be_left_out():
    assert families() == list(CATALOGUE)
    assert families(["gain", "lag"]) == [name for name in CATALOGUE if name not in ("gain", "lag")]


@pytest.mark.parametrize("family", sorted(KNOWN))
def test_a_card_says_all_that_there_is_to_say(family):
    card = KNOWN[family].card
    assert card.family == family
    for text in (card.equation, card.source, card.signature, card.excitation):
        assert len(text) >= 10 and text == text.strip()
    assert card.scope in Scope and KNOWN[family].place in Place
    assert card.depends_on and {text.partition(":")[0] for text in card.depends_on} <= VARIABLES
    assert {name.partition(":")[0] for name in card.confounded_with} <= CONTRACT - {family}
    assert KNOWN[family].__doc__


@pytest.mark.parametrize("family", sorted(CATALOGUE | BEYOND_THE_CONTRACT))
def test_parameters_are_bounded_about_neutral_and_grids_lie_within(family):
    card = KNOWN[family].card
    assert len({parameter.name for parameter in card.parameters}) == len(card.parameters) > 0
    for parameter in card.parameters:
        assert parameter.unit in UNITS
        assert parameter.lower <= parameter.neutral <= parameter.upper and parameter.lower < parameter.upper
        assert all(parameter.lower <= value <= parameter.upper for value in parameter.grid)
        assert len(set(parameter.grid)) == len(parameter.grid)


@pytest.mark.parametrize("family", sorted(KNOWN))
def test_neutral_grid_and_variants_name_the_wrappers_parameters(family):
    effect = KNOWN[family](SETTING)
    neutral = effect.neutral()
    assert all(value.shape[0] == SETTING.n_joint for value in neutral.values())
    for point in effect.grid():
        assert set(point) <= set(neutral)
    gridded = {name for point in effect.grid() for name in point}
    for variant in effect.variants():
        for freed in variant:
            assert all(name in neutral and name not in gridded for name, _ in freed)
