"""These tests compile much and run little."""

from tests.compilation import quick_compilation  # noqa: F401  autouse
