"""Step 6: all that a run came to, which closed_loop.json and the report are written from."""

from dataclasses import dataclass

from pipeline.discrepancy.acceptance.accept import Acceptance
from pipeline.discrepancy.correction.correct import Correction
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.prepare import PreparedLogs
from pipeline.discrepancy.experiment.plan import Plan
from pipeline.discrepancy.selection.select import Selection


@dataclass(frozen=True)
class Verdict:
    """The records of all steps."""

    diagnosis: Diagnosis
    selection: Selection
    acceptance: Acceptance
    correction: Correction
    plan: Plan | None = None

    @property
    def logs(self) -> PreparedLogs:
        """Of the first step."""
        return self.diagnosis.logs
