"""Step 3: the effects that explain most of the rows for fitting and selection."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.families.stops import Encoder, encoders_of
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.comparison import Comparison
from pipeline.discrepancy.selection.search import Search
from pipeline.discrepancy.selection.selected_effect import SelectedEffect


@dataclass(frozen=True)
class Selection:
    """What the search came to.

    Attributes:
        found: Effects on single joints, fitted.
        screened: All candidates of the first screen, best first.
        comparison: By which candidates passed.
        encoders: What stops say of joints' encoders.
    """

    found: Sequence[SelectedEffect]
    screened: Sequence[Candidate]
    comparison: Comparison
    encoders: Mapping[int, Encoder]


def select(diagnosis: Diagnosis, journal: Journal) -> Selection:
    """Search the catalogue and the dependences."""
    nominal, config = diagnosis.nominal, diagnosis.logs.config
    encoders = encoders_on(diagnosis)
    search = Search(
        diagnosis.simulation,
        diagnosis.rows,
        nominal.null,
        config.search,
        config.exclude,
        encoders,
        diagnosis.logs.joints,
        diagnosis.excited,
        journal.log,
        nominal.present,
        nominal.at_rest.tolist(),
        diagnosis.known,
    )
    found = search.run()
    journal.end_part("search on measured logs")
    return Selection(found, search.first, search.comparison, encoders)


def encoders_on(diagnosis: Diagnosis) -> dict[int, Encoder]:
    """By the stops that were met on rows for fitting and selection."""
    machine, nominal = diagnosis.logs.machine, diagnosis.nominal
    rows = diagnosis.logs.sequences._replace(is_row=diagnosis.rows.is_used)
    return encoders_of(
        nominal.simulation.sequences, rows, machine.lower, machine.upper, nominal.setting.speed_scale
    )
