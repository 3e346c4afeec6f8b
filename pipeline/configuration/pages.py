"""The page that a command writes beside its results.

Results do not depend on how they are told: the modules of a page are imported when one is written, and in the graph of
`dvc.yaml` pages have stages of their own.
"""

import importlib
from typing import Any


def write_page(name: str, *arguments: Any) -> None:
    """Call `write` of the module `pipeline.reporting.pages.<name>`."""
    importlib.import_module(f"pipeline.reporting.pages.{name}").write(*arguments)
