import pytest

from pipeline.errors import InputError
from pipeline.plant.sealed.undeclared import draw_effects, parameters_of_session


def test_the_same_seed_draws_the_same_effect(nominal):
    first, second = (draw_effects(["drawn"], 5, nominal, 1.0, 600.0) for _ in range(2))
    assert (first[0].kind, first[0].joints, first[0].truth) == (
        second[0].kind,
        second[0].joints,
        second[0].truth,
    )


def test_seeds_draw_different_kinds(nominal):
    kinds = {draw_effects(["drawn"], seed, nominal, 1.0, 600.0)[0].kind for seed in range(6)}
    assert len(kinds) > 1


def test_one_of_several_kinds_is_drawn(nominal):
    kinds = {draw_effects(["delay|lag"], seed, nominal, 1.0, 600.0)[0].kind for seed in range(8)}
    assert kinds == {"delay", "lag"}
    with pytest.raises(InputError, match=r"'lags' is not known"):
        draw_effects(["delay|lags"], 0, nominal, 1.0, 600.0)


def test_a_pump_that_moves_nothing_is_refused(nominal):
    with pytest.raises(InputError, match=r"flow_coupling: size 3 leaves no motion enough flow; at most 1\.6"):
        draw_effects(["flow_coupling"], 0, nominal, 3.0, 600.0)


def test_an_unknown_kind_is_refused_with_the_known_ones(nominal):
    with pytest.raises(InputError, match=r"'gains' is not known; choose from .*gain"):
        draw_effects(["gains"], 0, nominal, 1.0, 600.0)


def test_an_effect_holds_in_every_session(nominal):
    drawn = draw_effects(["delay"], 1, nominal, 1.0, 600.0)
    for session in (0, 1):
        parameters, changes = parameters_of_session(nominal, drawn, session)
        assert changes == []
        assert (parameters.pilot.dead_time_s != nominal.pilot.dead_time_s).any()


def test_a_change_point_sets_in_during_the_first_session_and_lasts(nominal):
    drawn = draw_effects(["change_point"], 2, nominal, 1.0, 600.0)
    assert 0.0 < drawn[0].onset_s < 600.0
    at_start, changes = parameters_of_session(nominal, drawn, 0)
    assert at_start is nominal
    assert [time for time, _ in changes] == [drawn[0].onset_s]
    later, changes_later = parameters_of_session(nominal, drawn, 1)
    assert later is not nominal and changes_later == []
