"""What was learned of nominal logs comes back as it was, and only for what it was learned from."""

from dataclasses import fields, replace

import jax
import numpy as np
import pytest

from pipeline.configuration.load import load_machine, load_section
from pipeline.discrepancy.diagnosis.diagnosis_model import DiagnosisModel
from pipeline.discrepancy.diagnosis.nominal import nominal_cache as module
from pipeline.discrepancy.diagnosis.nominal.nominal_cache import (
    Learned,
    identity,
    load_learned,
    save_learned,
    without,
)
from pipeline.discrepancy.selection.candidate import Candidate, Misfit
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from tests.dynamics.conftest import make_fir_specification

draw = np.random.default_rng(3)


def misfit(family: str, source: int | None, freed) -> Misfit:
    values = draw.normal(size=len(freed)), draw.normal(size=9)
    return Misfit(Candidate(family, 2, source, {"width": 0.1}, freed, values[0], 1.5, 0.1, values[1]), 0.007)


@pytest.fixture
def learned() -> Learned:
    model = FirModel(make_fir_specification(1.0, np.ones(4), 20, stop_lower=[-1.0, None, -1.0, -1.0]))
    parameters = model.initialise(jax.random.key(3))
    misfits = [
        misfit("gain", None, ((("ratio_positive", None), ("ratio_negative", None)),)),
        misfit("other:position", 1, ((("coefficients", (0, 1, 2)),), (("coefficients", (1, 1, 2)),))),
        misfit("flow_coupling", None, ((("loss", 3),),)),
    ]
    null = {of.candidate.key: of for of in misfits}
    diagnosis = DiagnosisModel(model, parameters, draw.normal(size=(2, 2, 50)) > 0.0)
    return Learned(diagnosis, null, ("thermal_drift",))


def test_it_comes_back_bit_by_bit(learned, tmp_path) -> None:
    save_learned(tmp_path / "new" / "learned.npz", learned, "this")
    found = load_learned(tmp_path / "new" / "learned.npz", "this")
    assert found is not None
    assert found.diagnosis.model.specification == learned.diagnosis.model.specification
    np.testing.assert_array_equal(found.diagnosis.left_out, learned.diagnosis.left_out)
    jax.tree.map(np.testing.assert_array_equal, found.diagnosis.parameters, learned.diagnosis.parameters)
    assert found.present == learned.present
    assert list(found.null) == list(learned.null)
    for key, known in learned.null.items():
        assert found.null[key].most_per_row == known.most_per_row
        for field in fields(Candidate):
            one, other = (getattr(of.candidate, field.name) for of in (found.null[key], known))
            assert np.array_equal(one, other) if isinstance(other, np.ndarray) else one == other


def test_of_anything_else_it_is_no_answer(learned, tmp_path) -> None:
    path = tmp_path / "learned.npz"
    assert load_learned(path, "this") is None
    save_learned(path, learned, "that")
    assert load_learned(path, "this") is None
    for content in (b"", b"PK\x03\x04", path.read_bytes()[:-200]):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"learned\.npz.*delete it"):
            load_learned(path, "that")


def test_no_damage_ends_in_anything_but_one_line(learned, tmp_path) -> None:
    path, random = tmp_path / "learned.npz", np.random.default_rng(5)
    save_learned(path, learned, "that")
    whole = path.read_bytes()
    n_refused = 0
    for _ in range(300):
        begin = int(random.integers(len(whole) - 8))
        path.write_bytes(whole[:begin] + random.bytes(8) + whole[begin + 8 :])
        try:
            load_learned(path, "that")
        except InputError:
            n_refused += 1
    assert n_refused > 200


def test_excluded_families_are_as_if_not_tried(learned) -> None:
    assert {key[0] for key in without(learned.null, ["gain", "lag"])} == {"other:position", "flow_coupling"}


def test_it_is_known_by_logs_machine_settings_and_code(monkeypatch) -> None:
    machine, config = load_machine("bobcat_e10"), load_section("close_loop", CloseLoopConfig, "paper")
    identify = load_section("identify", IdentifyConfig, "paper")
    longer = replace(identify.training_of("nfir_dqdot"), maximum_epochs=1000)
    other_kind = replace(identify, selected=identify.selected | {"mlp_dq": longer})
    n = 30
    log = Trajectory(
        name="log",
        t_s=0.05 * np.arange(n),
        stamp_ns=np.arange(n) * 50_000_000,
        q=draw.normal(size=(n, 4)),
        qd=draw.normal(size=(n, 4)),
        a=draw.integers(-1, 2, size=(n, 4)).astype(float),
        is_validation=np.zeros(n, bool),
    )
    swing, *others = machine.joints
    wider = replace(machine, joints=(replace(swing, upper=swing.upper + 0.1), *others))
    first = identity([log], machine, config, identify)
    assert identity([log], machine, replace(config, exclude=["gain"]), other_kind) == first
    answers = [
        identity([replace(log, q=log.q + 1e-9)], machine, config, identify),
        identity([log, log], machine, config, identify),
        identity([log], wider, config, identify),
        identity([log], machine, replace(config, seed=config.seed + 1), identify),
        identity([log], machine, config, replace(identify, selected={"nfir_dqdot": longer})),
    ]
    monkeypatch.setattr(module, "code_fingerprint", lambda: "other")
    answers.append(identity([log], machine, config, identify))
    assert len({first, *answers}) == len(answers) + 1
