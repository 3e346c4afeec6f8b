"""MLflow experiments: one per question, so that comparable runs stand together."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Question:
    """An experiment: its name, the question that its runs answer, and the stages that run in it."""

    experiment: str
    text: str
    stages: tuple[str, ...]


QUESTIONS = (
    Question(
        "data", "What was recorded, and is it sound?", ("record", "record_changed", "teleoperate", "ingest")
    ),
    Question("models", "Which model predicts the machine best?", ("identify", "judge", "search", "select")),
    Question(
        "controllers",
        "Which controller reaches its targets best, and what does it cost?",
        ("ppo", "apg", "evaluate_brax", "evaluate_icem", "reward_ablation", "pictures"),
    ),
    Question(
        "changed machine",
        "What has changed in the machine, and does the corrected model predict better?",
        ("close_loop", "unseal", "control_level", "repair", "prove", "promote", "rollback"),
    ),
    Question(
        "deployment",
        "Does the controller hold on the machine, through the graph that drives it?",
        ("sim2sim", "sweep_delays", "sim2real", "run_graph", "measure_delays", "evaluate_logs"),
    ),
    Question("pipelines", "What did a whole run of the pipeline yield?", ("report",)),
)


def question_of(stage: str) -> Question:
    """The question that a stage's runs answer; an unlisted stage gets its own experiment."""
    for question in QUESTIONS:
        if stage in question.stages:
            return question
    return Question(stage, "", (stage,))
