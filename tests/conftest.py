"""What all tests share: a program that one process compiled, no other test, worker or stage compiles again."""

import os
import tempfile

import pytest

# Set before JAX is imported anywhere; workers and the processes that tests start inherit it.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    _compiled = tempfile.TemporaryDirectory(prefix="compiled-", ignore_cleanup_errors=True)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = _compiled.name
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.2"
    os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"  # XLA tells of every program that it finds there
    os.environ.setdefault("NUMBA_CACHE_DIR", _compiled.name)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that hold slow tests begin first, so that no worker is left alone with one of them at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)
