"""Damaged, odd and hostile logs: how each is made, and what must come of it.

One file per chapter; `case.py` says what a case is.
"""

from tests.logs.damage import (
    bag_folders,
    bombs,
    cut_off,
    further_kinds,
    killed_writers,
    nothing_wanted,
    odd_files,
    overwritten,
)
from tests.logs.damage.case import REGISTERED

CHAPTERS = (
    cut_off,
    overwritten,
    nothing_wanted,
    killed_writers,
    bag_folders,
    odd_files,
    bombs,
    further_kinds,
)
CASES = [case for chapter in CHAPTERS for case in REGISTERED if case.builder.__module__ == chapter.__name__]
