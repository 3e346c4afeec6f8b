"""Tables and page of a reward ablation, of what is finished of it."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.control.reward_ablation import Ablation, RewardAblationConfig, finished
from pipeline.reporting.chapters.reward_ablation import ablation_beside_paper, ablation_page, ablation_table
from pipeline.reporting.results.paper import origin_of


def write_ablation(
    output: Path,
    ablation: Ablation,
    settings: RewardAblationConfig,
    logs: str,
    provenance: Sequence[tuple[str, str]],
) -> None:
    """Write `tables` and `index.html` from the cells in `output`.

    Args:
        output: Folder of the ablation.
        ablation: What the cells share.
        settings: Which cells there are.
        logs: The folder of logs that the model is from.
        provenance: Name and value of what the figures were made from.
    """
    rows = finished(output / "cells", settings, ablation.identity)
    kind, origin = ablation.dynamics.specification.kind, origin_of(logs)
    ablation_table(rows, kind, origin).write(output / "tables", "reward_ablation")
    ablation_beside_paper(rows, kind, origin).write(output / "tables", "reward_ablation_beside_paper")
    (output / "index.html").write_text(ablation_page(rows, kind, origin, provenance), encoding="utf-8")
