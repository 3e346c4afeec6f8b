"""Stages run as commands within the tests' process, where the process itself is not what a test is about.

Of a short command most is start-up: some eight seconds of imports, and programs compiled anew.
"""

import contextlib
import importlib
import io
import subprocess
import sys
from pathlib import Path
from unittest import mock


def run_stage(stage: str, *overrides: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """What `python -m pipeline.stages.<stage> <overrides>` in `folder` would print and end with.

    With `tracking=none`, unless the overrides say otherwise.
    """
    is_tracked = any(override.startswith("tracking=") for override in overrides)
    arguments = [f"{stage}.py", *overrides, *([] if is_tracked else ["tracking=none"])]
    main = importlib.import_module(f"pipeline.stages.{stage}").main
    said, errors = io.StringIO(), io.StringIO()
    with (
        mock.patch.object(sys, "argv", arguments),
        contextlib.chdir(folder),
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(errors),
        # which composes all once more to find `hydra.mode`; without, -m alone decides
        mock.patch("hydra._internal.hydra.Hydra.get_mode", return_value=None),
        # which closes the streams of handlers that are there already, pytest's among them
        mock.patch("hydra._internal.logging_config.configure_logging"),
    ):
        try:
            main()
            status = 0
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
    return subprocess.CompletedProcess(arguments, status, said.getvalue(), errors.getvalue())
