"""What closing the loop gives."""

from dataclasses import dataclass
from typing import Any

from pipeline.discrepancy.verdict.report_data import ReportData
from pipeline.effects.store import ActiveEffects


@dataclass(frozen=True)
class ClosedLoop:
    """The result.

    Attributes:
        document: closed_loop.json (contract, section 4).
        effects: What `model_after` has around the frozen model; None: nothing.
        evidence: For the report.
    """

    document: dict[str, Any]
    effects: ActiveEffects | None
    evidence: ReportData
