"""Studies: shared by workers, killed and resumed, and nothing is lost or done twice."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import optuna
import pytest
from optuna.trial import TrialState

from pipeline.errors import InputError
from pipeline.study.liveness import is_known_dead, own_identity
from pipeline.study.settings import Pruner, SamplerKind
from pipeline.study.storage import open_storage, refuse_password, without_password
from pipeline.study.trials import TrialOutcome
from pipeline.study.worker import DivergedError, Study

from . import study_worker
from .study_worker import EPOCHS, propose, settings, value

ROOT = Path(__file__).parents[1]


def start(storage: str, n_trials: int, epoch_s: float, log: Path) -> subprocess.Popen:
    command = [sys.executable, "-m", "tests.study_worker", storage, str(n_trials), str(epoch_s), str(log)]
    return subprocess.Popen(command, cwd=ROOT)


def lines(log: Path) -> list[list[str]]:
    return [line.split() for line in log.read_text().splitlines()] if log.exists() else []


def wait_for_starts(log: Path, count: int) -> None:
    deadline_s = time.monotonic() + 30
    while sum(line[0] == "start" for line in lines(log)) < count:
        assert time.monotonic() < deadline_s, "the workers did not start"
        time.sleep(0.01)


def run_here(study: Study, n_trials: int, evaluate=None) -> None:
    def cheap(proposal, trial):
        return value(*proposal), {}

    study.run(n_trials, propose, evaluate or cheap)


def summary(study: Study) -> list[tuple]:
    return [(trial.number, trial.outcome, trial.parameters, trial.value) for trial in study.trials()]


def storage_url(kind: str, folder: Path) -> str:
    return {"journal": str(folder / "a.journal"), "sqlite": f"sqlite:///{folder}/a.db"}[kind]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["journal", "sqlite"])
def test_a_killed_study_resumes_to_what_it_would_have_been(kind, tmp_path):
    whole, log = tmp_path / "whole", tmp_path / "log"
    whole.mkdir()
    study_worker.main(storage_url(kind, whole), 12, 0.0, str(whole / "log"))
    killed = storage_url(kind, tmp_path)
    for n_started in (3, 6):  # killed twice, each time within a trial
        worker = start(killed, 12, 0.03, log)
        wait_for_starts(log, n_started)
        worker.kill()
        assert worker.wait() == -signal.SIGKILL
    assert start(killed, 12, 0.0, log).wait(30) == 0
    ends = Counter(line[1] for line in lines(log) if line[0] == "end")
    assert set(ends.values()) == {1}, "a finished trial was done again"
    assert summary(Study(killed, "study", settings(), EPOCHS)) == summary(
        Study(storage_url(kind, whole), "study", settings(), EPOCHS)
    )
    retried = [trial for trial in Study(killed, "study", settings(), EPOCHS).trials() if trial.attempts > 1]
    assert 1 <= len(retried) <= 2


@pytest.mark.long
def test_four_workers_finish_exactly_the_total_though_one_is_killed(tmp_path):
    storage, log = str(tmp_path / "a.journal"), tmp_path / "log"
    workers = [start(storage, 24, 0.03, log) for _ in range(4)]
    wait_for_starts(log, 8)
    workers[0].kill()
    assert [worker.wait(60) for worker in workers] == [-signal.SIGKILL, 0, 0, 0]
    trials = Study(storage, "study", settings(), EPOCHS).trials()
    assert [trial.number for trial in trials] == list(range(24))
    assert TrialOutcome.open not in {trial.outcome for trial in trials}
    ends = Counter(line[1] for line in lines(log) if line[0] == "end")
    # The killed one may have ended a trial that it could not tell of any more.
    assert sum(ends.values()) <= len(ends) + 1
    attempts = optuna.load_study(study_name="study", storage=open_storage(storage)).trials
    assert not [a for a in attempts if a.state in (TrialState.RUNNING, TrialState.WAITING)]
    complete = [a for a in attempts if a.state is TrialState.COMPLETE]
    assert len(complete) + sum(a.state is TrialState.PRUNED for a in attempts) == 24
    assert min(a.value for a in complete) == min(value(**a.params) for a in complete)


def test_proposals_depend_on_the_seed_and_the_results_alone(tmp_path):
    def proposals(name, **changes):
        study = Study(str(tmp_path / name), "study", settings(**changes), EPOCHS)
        run_here(study, 10)
        return [trial.parameters for trial in study.trials()]

    assert proposals("first") == proposals("second")
    assert proposals("first") != proposals("third", seed=4)
    assert proposals("fourth", sampler=SamplerKind.random) != proposals("first")


def test_the_total_grows_and_never_shrinks(tmp_path):
    study = Study(str(tmp_path / "a.journal"), "study", settings(), EPOCHS)
    run_here(study, 4)
    first = summary(study)
    run_here(study, 2)
    assert summary(study) == first
    run_here(study, 7)
    assert summary(study)[:4] == first and len(summary(study)) == 7


def test_equal_hyper_parameters_are_evaluated_once(tmp_path):
    evaluated = []

    def evaluate(proposal, trial):
        evaluated.append(proposal)
        return value(*proposal), {"sum": sum(proposal)}

    study = Study(str(tmp_path / "a.journal"), "study", settings(), EPOCHS)
    run_here(study, 30, evaluate)
    assert len(evaluated) == len(set(evaluated)) < 30
    for trial in study.trials():
        assert trial.value == value(**trial.parameters)
        if "same_as" in trial.facts:
            assert study.trials()[trial.facts["same_as"]].parameters == trial.parameters


def test_divergence_is_a_result_and_the_sampler_sees_it(tmp_path):
    def evaluate(proposal, trial):
        if proposal[0] >= 4:
            raise DivergedError("not finite")
        return float("nan") if proposal[1] == 0 else value(*proposal), {}

    study = Study(str(tmp_path / "a.journal"), "study", settings(), EPOCHS)
    run_here(study, 20, evaluate)
    outcomes = {
        (trial.parameters["x"] >= 4 or trial.parameters["y"] == 0, trial.outcome) for trial in study.trials()
    }
    assert outcomes == {(True, TrialOutcome.diverged), (False, TrialOutcome.complete)}
    assert all(
        "not finite" in t.reason or "nan" in t.reason
        for t in study.trials()
        if t.outcome is TrialOutcome.diverged
    )
    late = [trial.outcome for trial in study.trials()][10:]
    assert late.count(TrialOutcome.diverged) < 5  # a uniform draw would give half of ten and more


@pytest.mark.parametrize("pruner", [Pruner.median, Pruner.hyperband])
def test_a_pruned_trial_ends_early(pruner, tmp_path):
    seen = Counter()

    def evaluate(proposal, trial):
        for epoch in range(1, 21):
            seen[trial.number] = epoch
            trial.report(epoch, value(*proposal) + 1.0 / epoch)
        return value(*proposal), {}

    study = Study(str(tmp_path / "a.journal"), "study", settings(pruner=pruner), 20)
    run_here(study, 25, evaluate)
    pruned = [trial for trial in study.trials() if trial.outcome is TrialOutcome.pruned]
    assert pruned and len(study.trials()) == 25
    for trial in pruned:
        assert trial.reason == f"pruned after epoch {seen[trial.number]}" and seen[trial.number] < 20
        assert trial.value is None


def test_what_the_user_must_mend_is_raised_and_the_trial_is_taken_up_again(tmp_path):
    study = Study(str(tmp_path / "a.journal"), "study", settings(), EPOCHS)

    def refuse(proposal, trial):
        raise InputError("logs too short")

    for _ in range(7):  # more often than a trial may kill its worker
        with pytest.raises(InputError, match="logs too short"):
            run_here(study, 3, refuse)
    proposed = study.trials()[0].parameters
    run_here(study, 3)
    assert [trial.outcome for trial in study.trials()] == [TrialOutcome.complete] * 3
    assert study.trials()[0].parameters == proposed


def test_an_interrupted_trial_goes_first_at_the_next_start(tmp_path):
    study = Study(str(tmp_path / "a.journal"), "study", settings(), EPOCHS)

    def interrupt(proposal, trial):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_here(study, 2, interrupt)
    order = []
    run_here(study, 2, lambda proposal, trial: (order.append(trial.number), (1.0, {}))[1])
    assert order[0] == 0


def test_a_trial_that_kills_every_worker_is_given_up(tmp_path):
    class Crash(Exception):
        pass

    study = Study(str(tmp_path / "a.journal"), "study", settings(maximum_attempts=3), EPOCHS)

    def crash(proposal, trial):
        if trial.number == 1:
            raise Crash
        return 1.0, {}

    for _ in range(3):
        with pytest.raises(Crash):
            run_here(study, 3, crash)
    run_here(study, 3, crash)
    assert [trial.outcome for trial in study.trials()] == [
        TrialOutcome.complete,
        TrialOutcome.given_up,
        TrialOutcome.complete,
    ]
    assert study.trials()[1].reason == "3 workers died over it"


def test_a_silent_workers_trial_is_taken_over_and_its_late_result_refused(tmp_path):
    storage = str(tmp_path / "a.journal")
    mine, theirs = (Study(storage, "study", settings(), EPOCHS) for _ in range(2))
    mine.identity, theirs.identity = "1-1.00@elsewhere", "2-1.00@elsewhere"

    def stall(proposal, trial):
        theirs_settings = settings(heartbeat_s=0.05, stale_after_s=0.3)
        fast = Study(storage, "study", theirs_settings, EPOCHS)
        fast.identity = theirs.identity
        run_here(fast, 1)  # waits until this trial's worker counts as dead, then does it
        return -1.0, {}

    silent = Study(storage, "study", settings(heartbeat_s=60.0, stale_after_s=120.0), EPOCHS)
    silent.identity = mine.identity
    run_here(silent, 1, stall)
    (trial,) = silent.trials()
    assert trial.value == value(**trial.parameters) and trial.attempts == 2
    assert silent.finished_by() == theirs.identity


def test_a_line_left_unfinished_is_cut_off(tmp_path):
    journal = tmp_path / "a.journal"
    run_here(Study(str(journal), "study", settings(), EPOCHS), 2)
    with journal.open("ab") as file:
        file.write(b'{"op_code": 4, "worker')
    study = Study(str(journal), "study", settings(), EPOCHS)
    run_here(study, 4)
    assert len(study.trials()) == len(Study(str(journal), "study", settings(), EPOCHS).trials()) == 4


@pytest.mark.parametrize(
    "content",
    [
        "my notes",
        "my notes\nof two lines\n",
        '{"a": 1}\n',
        "[1]\n",
        '{"op_code":0}\n',
        '{"op_code":0,\nmine\nx\n',
    ],
)
def test_a_file_of_something_else_is_no_journal(content: str, tmp_path: Path) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text(content)
    with pytest.raises(InputError, match=r"mine\.txt: not a journal of studies"):
        open_storage(str(mine))
    assert mine.read_text() == content


def test_a_process_is_known_dead_when_it_is():
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    identity = own_identity().replace(f"{os.getpid()}-", f"{process.pid}-")
    assert is_known_dead(identity)  # another start time: the number was given away again
    process.kill()
    process.wait()
    assert is_known_dead(identity)
    assert not is_known_dead(own_identity())
    assert not is_known_dead(f"{process.pid}-1.00@another-computer")


def test_a_password_is_neither_shown_nor_accepted():
    url = "postgresql://me:secret@host/db"
    assert "secret" not in without_password(url)
    with pytest.raises(InputError, match="PGPASSWORD") as refusal:
        refuse_password(url)
    assert "secret" not in str(refusal.value)
    refuse_password("postgresql://me@host/db")
    refuse_password("folder/a.journal")


@pytest.mark.parametrize(
    ("storage", "said"),
    [
        ("oracle9://x/y", "no driver"),
        ("sqlite:////proc/none/a.db", "proc"),
        ("://", "not the URL of a database"),
    ],
)
def test_a_storage_that_cannot_be_is_one_line(storage, said):
    with pytest.raises((InputError, OSError), match=said):
        open_storage(storage)
