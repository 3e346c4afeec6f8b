"""Programs compiled with little effort, for tests that compile much and run little."""

import contextlib
import os
from collections.abc import Iterator

import jax
import pytest

NAME = "jax_disable_most_optimizations"


@contextlib.contextmanager
def compiled_quickly() -> Iterator[None]:
    """Compile without most optimisations, here and in processes that are started meanwhile."""
    before = jax.config.read(NAME)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(os.environ, NAME.upper(), "1")
        jax.config.update(NAME, True)
        yield
        jax.config.update(NAME, before)


@pytest.fixture(scope="package", autouse=True)
def quick_compilation() -> Iterator[None]:
    """For a package whose `conftest.py` imports it."""
    with compiled_quickly():
        yield


@pytest.fixture(scope="module")
def module_compiled_quickly() -> Iterator[None]:
    """For a module that asks for it."""
    with compiled_quickly():
        yield
