"""The page of a closed loop, made from the files that `close_loop` wrote."""

from pathlib import Path

from pipeline.discrepancy.verdict.files import DOCUMENT, REPORT_DATA, LoopReport
from pipeline.files.atomic import write_whole
from pipeline.files.record_file import load_record
from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.closed_loop.report import write_closed_loop_report
from pipeline.reporting.page import render_page
from pipeline.reporting.pages import experiment
from pipeline.reporting.results.files import read_json

NAME = "report.html"


def write(folder: Path, machine: MachineSpecification) -> None:
    """Write the page into the folder that `close_loop` wrote, and that of the next experiment where one is planned.

    Raises:
        InputError: A file is missing or damaged, or the page cannot be written.
    """
    experiment.write(folder, machine)
    document, report = read_json(folder / DOCUMENT), load_record(folder / REPORT_DATA, LoopReport)
    if report.data is None:
        page = render_page("The loop was not closed", f"{document['note']}.", [], [], [])
        write_whole(folder / NAME, page.encode())
        return
    sources = report.machine, report.nominal, report.measured
    write_closed_loop_report(folder / NAME, document, report.data, *sources)
