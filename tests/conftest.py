"""What all tests share, so that it is made once: compiled programs, and the tables of MLflow's database."""

import gc
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# How fast a busy machine is, is measured in benchmarks; here it would only fail tests now and then.
settings.register_profile(
    "untimed", max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("untimed")

# What JAX traced stays and is millions of objects: to look through them as often as usual takes a tenth of the time.
gc.set_threshold(50_000, 20)

# Set before JAX is imported anywhere; workers and the processes that tests start inherit it.
# Tests compile much and run little: without optimisation, with XLA's older emitters, this takes a fifth of the time.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
os.environ.setdefault(
    "XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
)
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    _compiled = tempfile.TemporaryDirectory(prefix="compiled-", ignore_cleanup_errors=True)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = _compiled.name
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.05"
    os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"  # XLA tells of every program that it finds there
    os.environ.setdefault("NUMBA_CACHE_DIR", _compiled.name)


@pytest.fixture
def optimised() -> Iterator[None]:
    """Compile as a user does: for equality to the last bit, which older emitters break without optimisation."""
    import jax

    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that hold slow tests begin first, so that no worker is left alone with one of them at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session")
def empty_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """MLflow's database with its tables, which take seconds to make, and no runs: to be copied."""
    from pipeline.tracking import TrackingConfiguration
    from pipeline.tracking.store import open_store

    path = tmp_path_factory.mktemp("store") / "mlflow.db"
    open_store(TrackingConfiguration(True, f"sqlite:///{path}", None, None))
    return path
