"""`effects.json`: a round trip, and one line on damage."""

import json
from dataclasses import replace

import jax
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.store import model_fingerprint, save_model
from pipeline.effects.augmented_model import AugmentedModel
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.effect import Setting
from pipeline.effects.predictor import AugmentedPredictor
from pipeline.effects.store import (
    FILE,
    ActiveEffects,
    dynamics_fingerprint,
    load_dynamics,
    load_effects,
    load_predictor,
    save_effects,
)
from pipeline.errors import InputError

from .conftest import SETTING, VALUES, make_model, random_trajectory

STAMP_NS = 1_700_000_000_123_456_789
EFFECTS = ActiveEffects(
    SETTING, VALUES, {"gain": {0: np.int64(STAMP_NS), 1: STAMP_NS + 5}, "lag": {1: STAMP_NS}}
)


@pytest.fixture
def saved(tmp_path):
    save_effects(tmp_path, EFFECTS)
    return tmp_path


def test_a_round_trip_keeps_everything(saved):
    loaded = load_effects(saved)
    assert loaded.onset_ns == EFFECTS.onset_ns
    assert loaded.setting.dt_s == SETTING.dt_s
    for name in ("lower", "upper", "speed_scale"):
        np.testing.assert_array_equal(getattr(loaded.setting, name), getattr(SETTING, name))
    assert jax.tree.structure(loaded.values) == jax.tree.structure(VALUES)
    jax.tree.map(np.testing.assert_array_equal, loaded.values, VALUES)
    content = (saved / FILE).read_bytes()
    save_effects(saved, loaded)
    assert (saved / FILE).read_bytes() == content


def test_one_onset_of_a_family_as_older_files_have_it_is_all_joints(saved):
    content = json.loads((saved / FILE).read_text())
    assert content["onset_ns"] == {"gain": [STAMP_NS, STAMP_NS + 5], "lag": [None, STAMP_NS]}
    content["onset_ns"] = {"gain": STAMP_NS}
    (saved / FILE).write_text(json.dumps(content))
    assert load_effects(saved).onset_ns == {"gain": {0: STAMP_NS, 1: STAMP_NS}}


def test_deviations_are_kept_and_must_be_those_of_values(tmp_path):
    deviations = {"gain": {"ratio_positive": np.array([0.1, 0.0])}}
    save_effects(tmp_path, replace(EFFECTS, deviations=deviations))
    loaded = load_effects(tmp_path)
    np.testing.assert_array_equal(loaded.deviations["gain"]["ratio_positive"], [0.1, 0.0])
    for wrong in ({"gain": {"ratio_positive": np.array([-0.1, 0.0])}}, {"gain": {"ratio": np.zeros(2)}}):
        save_effects(tmp_path, replace(EFFECTS, deviations=wrong))
        assert "deviations of gain" in refused(tmp_path)


def test_a_folder_without_effects_has_none(tmp_path):
    assert load_effects(tmp_path) is None


def test_families_are_those_that_are_not_neutral():
    values = {**{family: KNOWN[family](SETTING).neutral() for family in KNOWN}, "lag": VALUES["lag"]}
    effects = ActiveEffects(SETTING, values, {})
    assert effects.families() == ["lag"]
    assert list(effects.chain(effects.families()).effects) == ["lag"]


def test_a_model_folder_is_a_predictor_with_its_effects(saved):
    model, log = make_model(), random_trajectory(1)
    parameters = model.initialise(jax.random.key(0))
    save_model(saved, model, parameters, {}, {}, {})
    starts = np.array([10, 20])
    some = {"gain": VALUES["gain"], "lag": VALUES["lag"]}
    effects = ActiveEffects(SETTING, some, EFFECTS.onset_ns)
    save_effects(saved, effects)
    found = load_predictor(saved)
    assert found.onset_ns == effects.onset_ns
    chain = effects.chain(["gain", "lag"])
    expected = AugmentedPredictor(model, parameters, chain, effects.values, effects.onset_ns)
    np.testing.assert_array_equal(found.predict(log, starts, 5), expected.predict(log, starts, 5))
    (saved / FILE).unlink()
    assert isinstance(load_predictor(saved), LearnedPredictor)


def test_a_model_folder_is_dynamics_with_its_effects(saved):
    model = make_model()
    save_model(saved, model, model.initialise(jax.random.key(0)), {}, {}, {})
    save_effects(saved, ActiveEffects(SETTING, {"gain": VALUES["gain"]}, {"gain": {0: 5}}))
    with_gain = dynamics_fingerprint(saved)
    dynamics, parameters = load_dynamics(saved)
    assert isinstance(dynamics, AugmentedModel)
    assert list(parameters.effects) == ["gain"]
    save_effects(saved, ActiveEffects(SETTING, {"lag": VALUES["lag"]}, {}))
    assert dynamics_fingerprint(saved) != with_gain
    (saved / FILE).unlink()
    assert type(load_dynamics(saved)[0]) is type(model)
    assert dynamics_fingerprint(saved) == model_fingerprint(saved) != with_gain


def test_effects_of_another_machine_are_refused(saved):
    model = make_model()
    save_model(saved, model, model.initialise(jax.random.key(0)), {}, {}, {})
    three = Setting(0.05, -np.ones(3), np.ones(3), np.ones(3))
    save_effects(saved, ActiveEffects(three, {"gain": KNOWN["gain"](three).neutral()}, {}))
    assert FILE in refused(saved, load_predictor)
    save_effects(saved, ActiveEffects(Setting(0.1, *vars_of(SETTING)), {}, {}))
    assert FILE in refused(saved, load_predictor)


def vars_of(setting: Setting) -> tuple:
    return setting.lower, setting.upper, setting.speed_scale


def refused(directory, load=load_effects) -> str:
    with pytest.raises(InputError) as caught:
        load(directory)
    message = str(caught.value)
    assert "\n" not in message and "close the loop again" in message
    return message


def _set(*path, to):
    def damage(content):
        for key in path[:-1]:
            content = content[key]
        content[path[-1]] = to

    return damage


DAMAGES = {
    "version": _set("schema_version", to=99),
    "unknown family": _set("values", "sorcery", to={"power": [1.0, 1.0]}),
    "family without parameters": _set("values", "gain", to={}),
    "foreign parameter": _set("values", "gain", "speed", to=[1.0, 1.0]),
    "too few joints": _set("values", "gain", "ratio_positive", to=[1.0]),
    "ragged": _set("values", "flow_coupling", "loss_fraction", to=[[0.0, 0.1], [0.2]]),
    "no number": _set("values", "gain", "ratio_positive", to=["fast", 1.0]),
    "not finite": _set("values", "gain", "ratio_positive", to=[float("nan"), 1.0]),
    "values are a list": _set("values", to=[]),
    "a family is a number": _set("values", "gain", to=3),
    "onset is infinite": _set("onset_ns", "gain", to=float("inf")),
    "onset of none": _set("onset_ns", "supply_variation", to=5),
    "onset of a joint is infinite": _set("onset_ns", "gain", to=[float("inf"), None]),
    "onsets of too few joints": _set("onset_ns", "gain", to=[5]),
    "onsets are ragged": _set("onset_ns", "gain", to=[[5], 5]),
    "onset is text": _set("onset_ns", "gain", to="noon"),
    "no setting": lambda content: content.pop("setting"),
    "time step": _set("setting", "dt_s", to=0.0),
    "time step is infinite": _set("setting", "dt_s", to=float("inf")),
    "limits": _set("setting", "lower", to=[1.0, 1.0]),
    "limits' shape": _set("setting", "upper", to=[[0.5, 0.35]]),
    "speed": _set("setting", "speed_scale", to=[0.5, -0.1]),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_told_in_one_line(saved, damage):
    content = json.loads((saved / FILE).read_text())
    DAMAGES[damage](content)
    (saved / FILE).write_text(json.dumps(content))
    assert FILE in refused(saved)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"null", b"3", b"\xff\xfe", b"{}", b"[" * 100_000])
def test_what_is_no_such_file_is_told_in_one_line(saved, content):
    (saved / FILE).write_bytes(content)
    assert FILE in refused(saved)


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_damage_is_read_or_refused(saved, data):
    json_value = st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=4),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
        max_leaves=6,
    )
    save_effects(saved, EFFECTS)
    content = json.loads((saved / FILE).read_text())
    place, key = content, data.draw(st.sampled_from(sorted(content)))
    while isinstance(place[key], dict) and place[key] and data.draw(st.booleans()):
        place, key = place[key], data.draw(st.sampled_from(sorted(place[key])))
    place[key] = data.draw(json_value)
    (saved / FILE).write_text(json.dumps(content))
    try:
        loaded = load_effects(saved)
    except InputError as error:
        assert "\n" not in str(error) and FILE in str(error)
    else:
        loaded.families()
