"""What a stage was given to read, and what it did not write, outlives its run."""

import os
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.files.path_checks import refuse_unusable
from pipeline.testbench.successive_targets import refuse_others_log
from pipeline.testbench.target_run import LOGS, SIMULATED, refuse_others_logs
from tests.stages.command import run_stage

START_TIME = "2026-04-01T09:00:00+00:00"
pytestmark = pytest.mark.slow


@pytest.mark.parametrize("place", ["logs/my_field_day", "simulated/my_field_day", "logs/targets"])
def test_run_graph_deletes_no_logs_of_ones_own(place: str, tmp_path: Path) -> None:
    bag = tmp_path / "out" / place / "day.mcap"
    bag.parent.mkdir(parents=True)
    bag.write_text("mine")
    refused = run_stage("run_graph", "model=none", "policy=none", "output=out", folder=tmp_path)
    assert refused.returncode == 2 and "holds logs that a finished run did not write" in refused.stderr
    assert bag.read_text() == "mine"


def test_run_graph_takes_an_earlier_runs_bags_for_its_own(tmp_path: Path) -> None:
    (tmp_path / "logs/targets").mkdir(parents=True)
    (tmp_path / "results.json").write_text("[]")
    refuse_others_logs(tmp_path, (LOGS, SIMULATED))
    (tmp_path / "simulated/another").mkdir(parents=True)
    with pytest.raises(InputError, match="simulated: holds logs that a finished run did not write"):
        refuse_others_logs(tmp_path, (LOGS, SIMULATED))


def test_sim2real_deletes_no_log_of_ones_own(tmp_path: Path) -> None:
    bag = tmp_path / "out/logs/2026-04-01-09-00-00"
    bag.mkdir(parents=True)
    (bag / "day.mcap").write_text("mine")
    refused = run_stage(
        "sim2real", "model=none", "policy=none", "output=out", f"start_time={START_TIME}", folder=tmp_path
    )
    assert (
        refused.returncode == 2 and f"holds logs that sim2real did not write ({bag.name})" in refused.stderr
    )
    assert (bag / "day.mcap").read_text() == "mine"
    (tmp_path / "out/goals.json").write_text("{}")
    refuse_others_log(bag)  # an earlier run's
    (tmp_path / "out/goals.json").unlink()
    refuse_others_log(bag.with_name("another"))  # beside it, which is not touched


@pytest.mark.parametrize(
    ("stage", "overrides", "said"),
    [
        ("view", ["logs=mine", "output=mine"], "output=mine: is logs=mine"),
        ("view", ["logs=mine", "output=mine/../mine/seen"], "lies in logs=mine"),
        ("view", ["logs=mine", "output=link"], "output=link: is logs=mine"),
        ("evaluate_logs", ["model=model", "logs=mine", "output=mine/day.mcap"], "lies in logs=mine"),
        ("evaluate_logs", ["model=model", "logs=mine/day.mcap", "output=mine/day.mcap"], "is logs="),
        ("evaluate_logs", ["model=model", "logs=mine", "output=model/meta.json"], "lies in model=model"),
        (
            "unseal",
            ["closed_loop=said.json", "seal=a.seal", "output=a.seal"],
            "output=a.seal: is seal=a.seal",
        ),
        ("unseal", ["closed_loop=said.json", "seal=a.seal", "output=said.json"], "is closed_loop=said.json"),
        (
            "close_loop",
            ["nominal=mine", "measured=other", "model=loop/model_after", "output=loop"],
            "output=loop: contains model=loop/model_after",
        ),
        (
            "close_loop",
            ["nominal=mine", "measured=other", "model=model", "output=linked"],
            "output=linked: contains model=model",
        ),
        ("close_loop", ["nominal=mine", "measured=other", "output=mine"], "output=mine: is nominal=mine"),
        ("identify", ["tuples=mine", "output=out", "checkpoints=mine"], "checkpoints=mine: is tuples=mine"),
        ("identify", ["tuples=mine/x", "output=out", "checkpoints=mine"], "checkpoints=mine: contains"),
        ("judge", ["models=[model]", "output=model/judged"], "output=model/judged: lies in models=model"),
    ],
)
def test_nothing_that_is_only_read_is_changed(
    stage: str, overrides: list[str], said: str, tmp_path: Path
) -> None:
    for name in ("mine/day.mcap", "a.seal", "said.json", "loop/model_after/effects.json", "model/meta.json"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("mine")
    (tmp_path / "link").symlink_to("mine")
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked/model_before").symlink_to("../model")
    refused = run_stage(stage, *overrides, folder=tmp_path)
    assert refused.returncode == 2
    (line,) = refused.stderr.splitlines()
    assert said in line and "which is only read; name another" in line
    files = [path for path in tmp_path.rglob("*") if path.is_file() and "runs" not in path.parts]
    assert len(files) == 5 and all(path.read_text() == "mine" for path in files)


@pytest.mark.parametrize(
    ("stage", "overrides", "said"),
    [
        (
            "close_loop",
            ["nominal=day/nominal", "measured=day/measured", "output=day"],
            "day/nominal: holds no logs",
        ),
        ("identify", ["tuples=mine", "output=mine/model"], "mine: no tuples"),
        (
            "evaluate_logs",
            ["model=model", "logs=mine", "output=mine/errors.json"],
            "model/meta.json: No such",
        ),
        ("search", ["tuples=mine", "output=out", "storage=mine/study.journal"], "mine: no tuples"),
    ],
)
def test_a_result_may_lie_beside_around_or_in_what_it_was_made_from(
    stage: str, overrides: list[str], said: str, tmp_path: Path
) -> None:
    for folder in ("mine", "model", "day/nominal", "day/measured"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "mine/errors.json").write_text("of an earlier run")
    refused = run_stage(stage, *overrides, folder=tmp_path)
    assert refused.returncode == 2 and said in refused.stderr  # the places are right, their content is not


def test_a_sweep_is_refused_before_any_of_its_jobs_starts(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    refused = run_stage("view", "-m", "logs=mine", "output=out,mine", folder=tmp_path)
    assert refused.returncode == 2 and "output=mine: is logs=mine" in refused.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("output", ["kept", "kept/out"])
def test_checkpoints_that_would_take_the_output_with_them_are_refused(output: str, tmp_path: Path) -> None:
    refused = run_stage("ppo", "model=none", f"output={output}", "checkpoints=kept", folder=tmp_path)
    assert refused.returncode == 2 and f"checkpoints=kept: holds output={output}" in refused.stderr


def test_a_model_kind_is_no_place(tmp_path: Path) -> None:
    done = run_stage("identify", "model=mlp", "tuples=none", "output=mlp", folder=tmp_path)
    assert done.returncode == 2 and "only read" not in done.stderr and "none" in done.stderr


@pytest.mark.parametrize(
    ("stage", "overrides", "said"),
    [
        ("close_loop", ["nominal=a", "measured=b", "output=notes"], "output=notes: notes is not a folder; "),
        ("ppo", ["model=none", "output=notes/policy"], "output=notes/policy: notes is not a folder; "),
        (
            "ppo",
            ["model=none", "output=out", "checkpoints=notes/x"],
            "checkpoints=notes/x: notes is not a folder; ",
        ),
        ("ingest", ["logs=a", "output=nowhere/tuples"], "output=nowhere/tuples: nowhere is not a folder; "),
        ("ingest", ["logs=a", "output=out", "report=notes"], "report=notes: notes is not a folder; "),
        ("ingest", ["logs=a", "output="], "output is empty; name a folder to write"),
        (
            "evaluate_logs",
            ["model=a", "logs=b", "output=folder"],
            "output=folder: is a folder; name the file",
        ),
        ("unseal", ["output=notes/judgement.json"], "notes is not a folder; "),
        ("search", ["storage=folder"], "storage=folder: is a folder; name the file to write"),
        ("ppo", ["model=none", f"output={'x' * 300}"], "File name too long; name another output"),
    ],
)
def test_an_output_that_cannot_be_written_is_refused_before_any_work(
    stage: str, overrides: list[str], said: str, tmp_path: Path
) -> None:
    (tmp_path / "notes").write_text("mine")
    (tmp_path / "folder").mkdir()
    (tmp_path / "nowhere").symlink_to("gone")
    refused = run_stage(stage, *overrides, folder=tmp_path)
    assert refused.returncode == 2, refused.stderr
    (line,) = refused.stderr.splitlines()
    assert line.startswith(f"error: {stage}: ") and said in line
    assert (tmp_path / "notes").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_must_not_be_written_to_is_refused(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir(mode=0o500)
    with pytest.raises(InputError, match="theirs must not be written to"):
        refuse_unusable("output", str(tmp_path / "theirs/out"), is_file=False)
