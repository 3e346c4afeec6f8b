"""These tests compile much and run little."""

from tests.reaching.conftest import quick_compilation  # noqa: F401  autouse
