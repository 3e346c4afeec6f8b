"""Of each study's trials one model is selected, by the rule that the profile states."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import jax
import yaml

from pipeline.dynamics.evaluation.inference_time import count_parameters, time_step, unit_scale_model
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.search.selection import explain, select, within_margin
from pipeline.dynamics.search.trial_table import read_candidates
from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.results.paper import KIND_NAMES, SELECTED_MODELS
from pipeline.reporting.tables.selection import (
    PublishedModel,
    SelectedModels,
    published_training,
    record,
    selection_table,
    table_csv,
)
from pipeline.study.configuration import SearchConfig


def searched_kinds(searched: Path) -> list[str]:
    """The kinds that were searched.

    Raises:
        InputError: There are none.
    """
    kinds = [kind for kind in KIND_NAMES if (searched / kind / "trials.csv").is_file()]
    if not kinds:
        raise InputError(
            f"searched={searched}: no folder KIND/trials.csv, KIND one of {', '.join(KIND_NAMES)}; "
            "run the stage search"
        )
    return kinds


def select_kind(
    searched: Path, kind: str, machine: MachineSpecification, search: SearchConfig, degree: int
) -> SelectedModels:
    """Measure the candidates within the margin, and select.

    Args:
        searched: Folder that holds a folder per kind, which the stage `search` wrote.
        kind: As `mlp_dqdot`.
        machine: That was searched for.
        search: The rule, and over how many calls times are measured.
        degree: Of the KAN's Legendre polynomials.

    Raises:
        InputError: No trial was completed, or the trials are of another machine or degree.
    """
    rule, n_calls = search.selection, search.timed_calls
    path = searched / kind / "trials.csv"
    ensemble = search.spaces[parts(kind)[0]].ensemble
    candidates = [
        dataclasses.replace(candidate, training=dataclasses.replace(candidate.training, ensemble=ensemble))
        for candidate in read_candidates(path)
    ]
    if not candidates:
        raise InputError(f"{path}: no trial was completed; search with other hyper-parameters")
    times = {}
    measured = []
    for candidate in within_margin(candidates, rule):
        model = unit_scale_model(machine, *parts(kind), candidate.training, degree)
        if count_parameters(model) != candidate.n_parameters:
            raise InputError(
                f"{path}: trial {candidate.trial} has {candidate.n_parameters} parameters, with this machine and "
                f"identify.legendre_degree={degree} it would have {count_parameters(model)}; search again"
            )
        times[candidate.trial] = time_step(model, n_calls)
        measured.append(dataclasses.replace(candidate, inference_time_s=times[candidate.trial].median_s))
    winner = select(measured, rule)
    published = None
    if kind in SELECTED_MODELS:
        model = unit_scale_model(machine, *parts(kind), published_training(kind), degree)
        published = PublishedModel(count_parameters(model), time_step(model, n_calls))
    return SelectedModels(kind, winner, explain(winner, measured, rule), measured, times, published)


def parts(kind: str) -> tuple[Parameterization, Target]:
    """Parameterization and target of a kind."""
    parameterization, target = kind.split("_")
    return Parameterization(parameterization), Target(target)


def write_selection(
    output: Path, selections: Sequence[SelectedModels], search: SearchConfig, profile: str
) -> str:
    """Write the paper's table, ours beside the published one, a file per kind and a snippet of a profile.

    Returns:
        The table in Markdown.
    """
    table = selection_table(selections, search.selection, profile, jax.devices()[0].device_kind)
    output.mkdir(parents=True, exist_ok=True)
    (output / "selected_models.md").write_text(table.markdown(), encoding="utf-8")
    (output / "selected_models.tex").write_text(table.latex(), encoding="utf-8")
    (output / "selected_models.csv").write_text(table_csv(table), encoding="utf-8")
    for selection in selections:
        write_json(output / f"{selection.kind}.json", record(selection))
    snippet = "# For section `identify` of a profile, or the command line of the stage identify.\n"
    selected = {
        selection.kind: {
            name: value
            for name, value in dataclasses.asdict(selection.winner.training).items()
            if value is not None
        }
        for selection in selections
    }
    snippet += yaml.safe_dump({"selected": selected}, sort_keys=False, default_flow_style=None)
    (output / "selected.yaml").write_text(snippet, encoding="utf-8")
    return table.markdown()
