"""The reward ablation: our table in the paper's form, a comparison with the paper's, and a page of both."""

import statistics
from collections.abc import Mapping, Sequence

from pipeline.control.reward_ablation import CellResult
from pipeline.reaching.reward import RewardTerm
from pipeline.reporting.page import Points, Section, render_page
from pipeline.reporting.results.paper import (
    KIND_NAMES,
    METRIC_COLUMNS,
    PAPER_EPISODES,
    PAPER_SEEDS,
    PPO_EVALUATED_STEPS,
    REWARD_ABLATION,
    REWARD_SUPERSCRIPTS,
    Published,
    machine_note,
)
from pipeline.reporting.table import Table
from pipeline.reporting.tables.counts import steps_text
from pipeline.reporting.tables.differences import Circumstances, difference_sentences
from pipeline.reporting.tables.evaluation import LEGEND, NONE, PATH_LENGTH, printed_figures

Rows = Mapping[tuple[RewardTerm, ...], Sequence[CellResult]]  # finished seeds by the summed terms
PAPER_KIND = "mlp_dqdot"  # model kind of the paper's ablation
RETURNS = "Returns are of the reward that the row was trained with."
FINE = "sr_002_002"


def superscripts(terms: Sequence[str]) -> str:
    """Key of `paper.REWARD_ABLATION`, in the order of Eq. reward_function."""
    return "+".join(mark for term, mark in REWARD_SUPERSCRIPTS.items() if term in terms)


def reward_symbols(terms: Sequence[str]) -> str:
    """`r^X + r^q`."""
    return " + ".join(f"r^{mark}" for mark in superscripts(terms).split("+"))


def published_rows(kind: str) -> Mapping[str, Mapping[str, Published]]:
    """The paper's rows by the marks of their terms; empty for model kinds other than `PAPER_KIND`."""
    return REWARD_ABLATION if kind == PAPER_KIND else {}


def ablation_table(rows: Rows, kind: str, origin: str) -> Table:
    """The paper's table with our figures; rows without a finished seed are empty.

    Args:
        rows: Finished seeds.
        kind: `<parameterization>_<target>` of the dynamics model.
        origin: Origin of the model's logs, `SIMULATED` or `OWN`.
    """
    columns = ["Reward function", *METRIC_COLUMNS.values()]
    printed = [[reward_symbols(terms), *_figures(cells)] for terms, cells in rows.items()]
    notes = [_counts(rows), RETURNS, LEGEND, PATH_LENGTH, machine_note(origin)]
    return Table(
        f"Performance of PPO {KIND_NAMES[kind]} when trained using different reward functions",
        columns,
        printed,
        notes,
    )


def ablation_beside_paper(rows: Rows, kind: str, origin: str) -> Table:
    """Our rows above the paper's, with numbers of seeds and episodes."""
    printed = []
    for terms, cells in rows.items():
        label = reward_symbols(terms)
        printed.append([label, "ours", *_figures(cells), str(len(cells)), _episodes(cells), _steps(cells)])
        if (published := published_rows(kind).get(superscripts(terms))) is not None:
            counts = [str(PAPER_SEEDS), str(PAPER_EPISODES), steps_text(PPO_EVALUATED_STEPS[PAPER_KIND])]
            printed.append([label, "paper", *map(str, published.values()), *counts])
    rules = [index for index, row in enumerate(printed) if index and row[1] == "ours"]
    columns = ["Reward function", "Whose", *METRIC_COLUMNS.values(), "Seeds", "Episodes", "Budget"]
    notes = [RETURNS, LEGEND, PATH_LENGTH, machine_note(origin)]
    return Table(
        f"Reward ablation of PPO {KIND_NAMES[kind]}, beside the paper's", columns, printed, notes, 1, rules
    )


def ablation_differences(rows: Rows, kind: str, origin: str) -> list[str]:
    """A sentence per large difference from the paper's figures."""
    sentences = []
    for terms, cells in rows.items():
        published = published_rows(kind).get(superscripts(terms))
        if not cells or published is None:
            continue
        ours = {metric: [cell.metrics[metric] for cell in cells] for metric in METRIC_COLUMNS}
        steps = min(cell.steps for cell in cells)
        budget = f"{steps_text(steps)} of training instead of {steps_text(PPO_EVALUATED_STEPS[PAPER_KIND])}"
        circumstances = Circumstances(budget if steps < PPO_EVALUATED_STEPS[PAPER_KIND] else "", origin)
        sentences += difference_sentences(reward_symbols(terms), ours, published, circumstances)
    return sentences


def precision_sentence(rows: Rows) -> str:
    """Whether r^ε yields high precision, as the paper finds."""
    rates: dict[bool, list[float]] = {True: [], False: []}
    for terms, cells in rows.items():
        rates[RewardTerm.precision in terms] += [cell.metrics[FINE] for cell in cells]
    if not all(rates.values()):
        return "Too few rows are finished to say what the precision bonus r^ε does."
    with_bonus, without = (100 * statistics.fmean(rates[key]) for key in (True, False))
    found = "more" if with_bonus > without else "not more"
    return (
        f"With the precision bonus r^ε {with_bonus:.0f} % of the episodes reach 0.02 m and 0.02 rad, without it "
        f"{without:.0f} % (means over the rows and seeds): {found}, where the paper finds it crucial."
    )


def ablation_page(rows: Rows, kind: str, origin: str, provenance: Sequence[tuple[str, str]]) -> str:
    """A separate page, as the ablation is outside `make repro`."""
    sentences = ablation_differences(rows, kind, origin)
    section = Section(
        "Terms of the reward left out",
        precision_sentence(rows),
        tables=[ablation_beside_paper(rows, kind, origin)],
        points=[Points(f"Where ours differ from the paper's ({len(sentences)})", sentences, folded=True)],
    )
    return render_page("Reward ablation", _counts(rows), [], [section], provenance)


def _figures(cells: Sequence[CellResult]) -> list[str]:
    return printed_figures({metric: [cell.metrics[metric] for cell in cells] for metric in METRIC_COLUMNS})


def _episodes(cells: Sequence[CellResult]) -> str:
    return " / ".join(dict.fromkeys(str(cell.metrics["n_episodes"]) for cell in cells)) or NONE


def _steps(cells: Sequence[CellResult]) -> str:
    return " / ".join(dict.fromkeys(steps_text(cell.steps) for cell in cells)) or NONE


def _counts(rows: Rows) -> str:
    everything = [cell for cells in rows.values() for cell in cells]
    fewest, most = (pick(len(cells) for cells in rows.values()) for pick in (min, max))
    seeds = f"{most} seed{'s' if most > 1 else ''}" if fewest == most else f"{fewest} to {most} seeds"
    return f"{seeds} per row, {_episodes(everything)} episodes each, {_steps(everything)}."
