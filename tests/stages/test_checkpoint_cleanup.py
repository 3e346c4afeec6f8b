"""What a user has in the folder named for checkpoints outlives the run that keeps its own there."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.configuration.load import load_machine
from pipeline.control.checkpoint import Checkpoint, is_checkpoint, load_checkpoint, save_checkpoint
from pipeline.control.chunks import evaluate_in_chunks, is_chunk
from pipeline.control.evaluate import EvaluatedEpisodes
from pipeline.dynamics.training.checkpoint import Checkpoints, is_training
from pipeline.errors import InputError
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.logs.formats.writer import write_bag
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.metrics import Traces
from pipeline.reaching.reward import RewardTerms
from tests.stages.command import run_stage

MINE = (
    "thesis.tex",
    "data/2024/day.bag",
    "0123456789abcdef/notes.txt",  # named as a training's folder is
    "episodes_1.npz",
    "policy/checkpoint.msgpack",
    ".thesis.tex.12.partial",
)


def lay(folder: Path) -> None:
    for name in MINE:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("mine")


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def keep_training(folder: Path) -> None:
    for settings in ("these", "those"):
        checkpoints: Checkpoints = Checkpoints(folder, settings)
        checkpoints.save(3, {"weights": jnp.ones(2)})
        checkpoints.close()


def keep_policy(folder: Path) -> None:
    save_checkpoint(folder, "training", Checkpoint(3, [np.ones(2)], [], None))
    (folder / ".checkpoint.msgpack.77.partial").write_text("half")


def keep_chunks(folder: Path) -> None:
    def evaluate(episodes: Episodes, _) -> EvaluatedEpisodes:
        content = episodes.starts
        return EvaluatedEpisodes(Traces(*[content] * len(Traces._fields)), RewardTerms(*[content] * 5))

    episodes = Episodes(np.zeros((5, 1)), np.zeros((5, 1)))
    evaluate_in_chunks(evaluate, episodes, 0, 3, folder, "evaluation", lambda n: None)


@pytest.mark.parametrize(
    ("keep", "is_own"),
    [(keep_training, is_training), (keep_policy, is_checkpoint), (keep_chunks, is_chunk)],
)
def test_only_checkpoints_are_removed(keep, is_own, tmp_path: Path) -> None:
    remove_checkpoints(tmp_path / "none", is_own)
    keep(tmp_path / "own")
    remove_checkpoints(tmp_path / "own", is_own)
    assert not (tmp_path / "own").exists()

    lay(tmp_path / "work")
    (tmp_path / "work/link").symlink_to(tmp_path / "work/data")
    keep(tmp_path / "work")
    assert files(tmp_path / "work") > set(MINE)
    remove_checkpoints(tmp_path / "work", is_own)
    assert files(tmp_path / "work") == set(MINE)


def test_a_file_of_another_program_is_not_taken_for_a_checkpoint(tmp_path: Path) -> None:
    (tmp_path / "checkpoint.msgpack").write_bytes(b"\x81\xa1a\x01")  # {"a": 1}
    with pytest.raises(InputError, match=r"checkpoint.msgpack: not a checkpoint of a training; name another"):
        load_checkpoint(tmp_path, "training")


@pytest.mark.long
def test_a_finished_run_leaves_what_it_did_not_write(tmp_path: Path) -> None:
    machine, random = load_machine("bobcat_e10"), np.random.default_rng(0)
    stamps = 1_700_000_000_000_000_000 + np.arange(2000, dtype=np.int64) * 20_000_000
    middle = (np.asarray(machine.lower) + np.asarray(machine.upper)) / 2
    write_bag(
        tmp_path / "logs/morning",
        machine,
        joint_state_header_stamp_ns=stamps,
        joint_state_log_time_ns=stamps,
        joint_names=machine.joint_names,
        positions=middle + 1e-3 * random.normal(size=(2000, machine.n_joint)).cumsum(axis=0),
        command_log_time_ns=stamps[::10],
        commands=random.integers(-1, 2, (200, machine.n_joint)).astype(float),
    )
    lay(tmp_path / "work")
    ingested = run_stage(
        "ingest", "logs=logs", "output=tuples", "ingest.validation_fraction=0.4", folder=tmp_path
    )
    assert ingested.returncode == 0, ingested.stderr
    done = run_stage(
        "identify",
        "profile=smoke",
        "tuples=tuples",
        "checkpoints=work",
        "output=model",
        "identify.selected.mlp_dqdot.hidden=[8]",
        "identify.selected.mlp_dqdot.maximum_epochs=2",
        "identify.checkpoint_every_epochs=1",
        "identify.evaluation_windows=4",
        folder=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "model/parameters.msgpack").exists()
    assert files(tmp_path / "work") == set(MINE)
