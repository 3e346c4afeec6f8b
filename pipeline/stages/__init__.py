"""Thin entry points: read the configuration, call the library, write artifacts, log the run."""

import gc

# What a stage imports and traces stays. To search it for unused objects as often as usual is a fifth of its start-up.
gc.set_threshold(50_000, 20)
