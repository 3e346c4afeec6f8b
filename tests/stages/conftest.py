"""Some of these tests compile much and run little: those that ask for `module_compiled_quickly`."""

from tests.compilation import module_compiled_quickly  # noqa: F401
