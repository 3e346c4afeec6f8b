"""The paper's table of evaluation results in the Brax environment: in the paper's form, and as a comparison."""

from collections.abc import Mapping, Sequence

from pipeline.reporting.results.controllers import (
    TRAINED,
    ControllerResult,
    by_controller,
    controller_title,
    in_order,
    split_name,
)
from pipeline.reporting.results.paper import (
    ALGORITHM_NAMES,
    BRAX_EVALUATION,
    KIND_NAMES,
    METRIC_COLUMNS,
    PAPER_EPISODES,
    PAPER_SEEDS,
    machine_note,
)
from pipeline.reporting.table import Table, mean_and_deviation
from pipeline.reporting.tables.counts import (
    BUDGET_LEGEND,
    budget_cell,
    counts_text,
    episodes_text,
    paper_budget_cell,
    smaller_budget,
)
from pipeline.reporting.tables.differences import Circumstances, difference_sentences

EVALUATION_METRICS = tuple(METRIC_COLUMNS)[:6]
OWN_METRICS = {
    "sr_012_008": "SR(0.12, 0.08)",
    "path_length_m": METRIC_COLUMNS["path_length_m"],
}  # absent in the paper
NONE = "–"
LEGEND = (
    "Mean ± standard deviation over seeds. SR(p, α): share of episodes within p m and α rad of the target at one tick "
    "at least. OOW, OOZ: share of episodes that left the restricted workspace, or its lower plane, at any tick."
)
VARIANTS = "† r^ε set to zero. ‡ r^ε and r^X set to zero. Returns of both are of the reward planned with."
PATH_LENGTH = (
    "EEF-PL: way of the end effector until the target is reached within 0.02 m and 0.02 rad, or to the end; the "
    "paper's 0.02 [cm] is read as 0.02 m."
)
END_STOPS = "Joint limits act as end stops in our environment; the paper is silent on them."


def brax_evaluation_table(controllers: Sequence[ControllerResult], origin: str) -> Table:
    """The paper's rows and columns with our figures; rows that were not run are empty."""
    groups = by_controller(controllers)
    rows = [
        [*_labels(name), *_figures(groups.get(name, []), EVALUATION_METRICS)]
        for name in in_order({*BRAX_EVALUATION, *groups})
    ]
    notes = [_counts_note(groups), LEGEND, VARIANTS, END_STOPS, machine_note(origin)]
    return Table(
        "Evaluation results obtained in the Brax-based training environment",
        ["Algo.", "Dyn. model", *(METRIC_COLUMNS[metric] for metric in EVALUATION_METRICS)],
        rows,
        notes,
        merged=1,
        rules=_rules(rows),
    )


def comparison_table(controllers: Sequence[ControllerResult], origin: str) -> Table:
    """Our rows above the paper's by controller, with numbers of seeds and episodes."""
    groups = by_controller(controllers)
    rows = []
    for name, group in groups.items():
        ours = _figures(group, (*EVALUATION_METRICS, *OWN_METRICS))
        counts = [str(len(group)), episodes_text(group), budget_cell(group)]
        rows.append([*_labels(name), "ours", *ours, *counts])
        if name in BRAX_EVALUATION:
            published = [str(figure) for figure in BRAX_EVALUATION[name].values()]
            counts = [str(PAPER_SEEDS), str(PAPER_EPISODES), paper_budget_cell(*split_name(name))]
            rows.append([*_labels(name), "paper", *published, *[NONE] * len(OWN_METRICS), *counts])
    columns = ["Algo.", "Dyn. model", "Whose", *(METRIC_COLUMNS[metric] for metric in EVALUATION_METRICS)]
    columns += [*OWN_METRICS.values(), "Seeds", "Episodes", "Budget"]
    notes = [LEGEND, PATH_LENGTH, BUDGET_LEGEND, VARIANTS, END_STOPS, machine_note(origin)]
    rules = [index for index, row in enumerate(rows) if index and row[2] == "ours"]
    return Table("Evaluation in the Brax environment, beside the paper's", columns, rows, notes, 2, rules)


def differences(controllers: Sequence[ControllerResult], origin: str) -> list[str]:
    """A sentence per large difference from the paper's figures."""
    sentences = []
    for name, group in by_controller(controllers).items():
        if name not in BRAX_EVALUATION:
            continue
        ours = {metric: _values(group, metric) for metric in EVALUATION_METRICS}
        circumstances = Circumstances(smaller_budget(group), origin)
        sentences += difference_sentences(controller_title(name), ours, BRAX_EVALUATION[name], circumstances)
    return sentences


def printed_figures(values: Mapping[str, Sequence[float]]) -> list[str]:
    """Cells of a row from values per seed, by metric; a dash without seeds."""
    return [mean_and_deviation(of_seeds) if of_seeds else NONE for of_seeds in values.values()]


def _labels(name: str) -> list[str]:
    algorithm, kind = split_name(name)
    return [ALGORITHM_NAMES[algorithm], KIND_NAMES[kind]]


def _values(group: Sequence[ControllerResult], metric: str) -> list[float]:
    return [controller.metrics[metric] for controller in group]


def _figures(group: Sequence[ControllerResult], metrics: Sequence[str]) -> list[str]:
    return printed_figures({metric: _values(group, metric) for metric in metrics})


def _rules(rows: Sequence[Sequence[str]]) -> list[int]:
    """Index of the rule between policies and planners, as in the paper."""
    policies = {ALGORITHM_NAMES[algorithm] for algorithm in TRAINED}
    trained = [row[0] in policies for row in rows]
    return [index for index in range(1, len(rows)) if trained[index] != trained[index - 1]]


def _counts_note(groups: Mapping[str, Sequence[ControllerResult]]) -> str:
    counts = [counts_text(controller_title(name), group) for name, group in groups.items()]
    missing = [controller_title(name) for name in BRAX_EVALUATION if name not in groups]
    return "; ".join(counts) + "." + (f" Not run: {', '.join(missing)}." if missing else "")
