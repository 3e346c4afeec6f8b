"""From a repair to the champion and back, as a user runs it: a tiny model with an effect, and a policy on it."""

import json
import shutil
from pathlib import Path

import jax
import numpy as np
import pytest
from mlflow import MlflowClient

from pipeline.configuration.load import load_machine
from pipeline.control.apg.network import initial_layers
from pipeline.control.policy import Policy, load_policy, save_policy
from pipeline.control.repair.files import read_repair
from pipeline.dynamics.model.dynamics_model import DynamicsModel, ModelSpecification
from pipeline.dynamics.model.store import save_model
from pipeline.effects.effect import Setting
from pipeline.effects.gain import Gain
from pipeline.effects.store import ActiveEffects, dynamics_fingerprint, save_effects
from pipeline.errors import InputError
from tests.stages.command import run_stage

MACHINE = load_machine("bobcat_e10")
N = 4


def write_model(folder: Path) -> DynamicsModel:
    model = DynamicsModel(
        ModelSpecification(
            parameterization="mlp",
            target="dqdot",
            hidden=[4],
            lags=3,
            legendre_degree=4,
            joints=list(MACHINE.joint_names),
            rate_hz=20.0,
            position_lower=MACHINE.lower.tolist(),
            position_upper=MACHINE.upper.tolist(),
            velocity_limit=[0.5] * N,
            residual_scale=[0.002] * N,
        )
    )
    save_model(folder, model, model.initialise(jax.random.key(0)), {"machine": MACHINE.name}, {}, {})
    return model


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Models before and after, and a policy of random weights."""
    folder = tmp_path_factory.mktemp("repair")
    model = write_model(folder / "before")
    write_model(folder / "after")
    setting = Setting(MACHINE.dt_s, MACHINE.lower, MACHINE.upper, np.ones(N))
    slower = {"gain": Gain(setting).neutral() | {"ratio_positive": np.full(N, 0.7)}}
    off = {"gain": {"ratio_positive": np.full(N, 0.05)}}
    save_effects(folder / "after", ActiveEffects(setting, slower, {}, off))
    size = model.specification.n_features + 2 * 7 + 2 * N
    policy = Policy(np.zeros(size), np.ones(size), initial_layers(jax.random.key(0), size, [16], N))
    save_policy(folder / "deployed", policy, {"model": dynamics_fingerprint(folder / "before")})
    return folder


@pytest.fixture(scope="module")
def repaired(folder: Path) -> Path:
    done = run_stage("repair", "policy=deployed", "model=after", "output=out", "profile=smoke", folder=folder)
    assert done.returncode == 0, done.stderr
    return folder / "out"


def test_a_repair_holds_both_policies_and_what_tells_them_apart(folder: Path, repaired: Path) -> None:
    document = json.loads((repaired / "repair.json").read_text())
    assert {"sr_before", "sr_after", "difference", "promotable", "reason"} <= set(document)
    lower, upper = document["difference"]["ci95"]
    assert lower <= document["difference"]["value"] <= upper
    assert document["n_targets"] == 16 and not document["effects_known_exactly"]
    assert document["on_machine"] is None
    former, new, deployed = (
        load_policy(of, MACHINE.name)[0]
        for of in (repaired / "former", repaired / "policy", folder / "deployed")
    )
    np.testing.assert_array_equal(former.layers[0].kernel, deployed.layers[0].kernel)
    assert not np.array_equal(new.layers[0].kernel, former.layers[0].kernel)
    assert load_policy(repaired / "policy", MACHINE.name)[1]["model"] == dynamics_fingerprint(
        folder / "after"
    )


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        (["model=before"], "before: has no effects around it; name the model_after that close_loop wrote"),
        (["policy=other"], "other: observes 5 values, after/effects.json stands around a model of "),
        (["policy=nowhere"], "nowhere/"),
        (["policy=foreign"], "foreign: is of machine mine, not of bobcat_e10; name a policy of this one"),
        (["policy_repair.margin=0"], "policy_repair.margin is 0.0; it must be positive"),
    ],
)
def test_mistakes_are_told_in_one_line(folder: Path, overrides: list[str], line: str) -> None:
    layers = initial_layers(jax.random.key(0), 5, [16], N)
    save_policy(folder / "other", Policy(np.zeros(5), np.ones(5), layers), {})
    save_policy(folder / "foreign", load_policy(folder / "deployed", MACHINE.name)[0], {"machine": "mine"})
    command = ["policy=deployed", "model=after", "output=wrong", "profile=smoke", *overrides]
    done = run_stage("repair", *command, folder=folder)
    assert done.returncode == 2
    (told,) = done.stderr.strip().splitlines()
    assert line in told


@pytest.mark.parametrize(
    "lost", ["margin", "machine", "promotable", "reason", "on_machine", "on_model", "policies"]
)
def test_a_repair_that_lacks_something_is_told_in_one_line(repaired: Path, tmp_path: Path, lost: str) -> None:
    shutil.copytree(repaired, tmp_path / "out")
    document = json.loads((tmp_path / "out/repair.json").read_text())
    del document[lost]
    (tmp_path / "out/repair.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=f"repair.json: not readable as a repair .*{lost}"):
        read_repair(tmp_path / "out")


def test_only_what_may_be_promoted_becomes_champion_and_one_command_takes_it_back(
    repaired: Path, empty_store: Path, tmp_path: Path
) -> None:
    shutil.copy(empty_store, tmp_path / "mlflow.db")
    client = MlflowClient(tracking_uri=f"sqlite:///{tmp_path}/mlflow.db")
    store = [f"tracking.uri=sqlite:///{tmp_path}/mlflow.db", f"tracking.artifacts={tmp_path}/artifacts"]
    shutil.copytree(repaired, tmp_path / "out")
    document = tmp_path / "out/repair.json"

    def run(stage: str, *overrides: str) -> tuple[int, str]:
        done = run_stage(stage, "tracking=sqlite", *store, *overrides, folder=tmp_path)
        return done.returncode, done.stdout + done.stderr

    def champion() -> Path:
        version = client.get_model_version_by_alias("bobcat_e10-policy", "champion")
        return Path(version.source.removeprefix("file://"))

    def say(promotable: bool) -> None:
        document.write_text(json.dumps(json.loads(document.read_text()) | {"promotable": promotable}))

    say(False)
    status, told = run("promote", "repair=out")
    assert status == 2 and "not promotable" in told
    assert run("rollback")[0] == 2  # there is no champion
    say(True)
    status, told = run("promote", "repair=out")
    assert status == 0, told
    assert "never driven on the machine" in told
    new = (tmp_path / "out/policy/policy.msgpack").read_bytes()
    assert (champion() / "policy.msgpack").read_bytes() == new
    status, told = run("rollback")
    assert status == 0, told
    former = (tmp_path / "out/former/policy.msgpack").read_bytes()
    assert (champion() / "policy.msgpack").read_bytes() == former != new
    assert run("rollback")[0] == 2  # it was the first
    (tmp_path / "out/policy/policy.msgpack").write_bytes(former)
    status, told = run("promote", "repair=out")
    assert status == 2 and "not the policy that was compared" in told
    status, told = run_stage("promote", "repair=out", folder=tmp_path).returncode, ""
    assert status == 2  # no registry


def test_both_policies_pursue_the_same_targets_on_the_machine_and_logs_of_it_say_the_same(
    repaired: Path, folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(repaired, tmp_path / "out")
    common = ["repair=out", f"model={folder / 'after'}", "profile=smoke", "episodes.steps=40"]
    done = run_stage("prove", *common, "output=out", folder=tmp_path)  # where the policies are
    assert done.returncode == 2 and "out/former: holds logs that prove did not write" in done.stderr
    done = run_stage("prove", *common, f"model={folder / 'before'}", folder=tmp_path)
    assert done.returncode == 2 and "out/policy: was not learned on" in done.stderr
    for targets in (1, 3):  # bags of an earlier proof give way
        sizes = f"targets={targets}", "session_targets=2"
        done = run_stage("prove", *common, *sizes, folder=tmp_path)
        assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "out/repair.json").read_text())
    on_machine = document["on_machine"]
    assert on_machine["n_targets"] == 3 and not document["promotable"]  # three prove nothing
    assert "on the machine its success rate may be" in document["reason"]
    bags = {
        name: sorted(bag.name for bag in (tmp_path / "out/trials" / name).iterdir())
        for name in ("former", "policy")
    }
    in_turn = sorted((bag, name) for name in bags for bag in bags[name])
    assert [name for _, name in in_turn] == ["former", "policy", "former", "policy"]
    write_back = (tmp_path / "out/repair.json").read_text()
    logs = [f"former={tmp_path}/out/trials/former", f"new={tmp_path}/out/trials/policy"]
    done = run_stage("prove", *common, *logs, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out/repair.json").read_text() == write_back
    done = run_stage("prove", *common, "targets=17", folder=tmp_path)
    assert done.returncode == 2 and "targets is 17; the evaluation has 16" in done.stderr
    done = run_stage("prove", *common, logs[0], folder=tmp_path)
    assert done.returncode == 2 and "name both folders, or none" in done.stderr


def test_where_nothing_was_found_nothing_is_repaired_driven_or_promoted(folder: Path) -> None:
    common = ["profile=smoke", "allow_empty=true"]
    done = run_stage("repair", "policy=deployed", "model=before", "output=none", *common, folder=folder)
    assert done.returncode == 0, done.stderr
    assert json.loads((folder / "none/repair.json").read_text()) == {
        "note": "before has no effects around it"
    }
    for overrides, why in (
        ([], "before has no effects around it"),
        (["measured=deployed"], "the logs in deployed are of your own machine"),
    ):
        done = run_stage("prove", "repair=none", "model=before", *overrides, *common, folder=folder)
        assert done.returncode == 0 and f"nothing is driven: {why}" in done.stdout, done.stderr
    done = run_stage("promote", "repair=none", folder=folder)
    assert done.returncode == 2
    assert "there is no repair: before has no effects around it" in done.stderr
