"""Runs in MLflow: an experiment per kind of question, a parent run per pipeline run or sweep, a child per stage.

The library does not import this package; stages pass it plain numbers and files.
"""

from pipeline.tracking.configuration import TrackingConfiguration
from pipeline.tracking.metrics import flatten_metrics
from pipeline.tracking.progress import ProgressBar, Stopwatch, progress_bar
from pipeline.tracking.stage_run import StageRun
from pipeline.tracking.track import track

__all__ = [
    "ProgressBar",
    "StageRun",
    "Stopwatch",
    "TrackingConfiguration",
    "flatten_metrics",
    "progress_bar",
    "track",
]
