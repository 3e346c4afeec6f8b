"""Nested metrics and parameters flattened to dotted names, as MLflow needs them."""

from collections.abc import Mapping
from typing import Any


def flatten_metrics(tree: Mapping[str, Any]) -> dict[str, float]:
    """Nested metrics as `a.b.c: number`; other values are left out."""
    return {
        key: float(value)
        for key, value in flatten(tree).items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }


def flatten(tree: Any, prefix: str = "") -> dict[str, Any]:
    """A tree of mappings as `a.b.c: leaf`."""
    if isinstance(tree, Mapping):
        return {
            key: value
            for name, branch in tree.items()
            for key, value in flatten(branch, f"{prefix}{name}.").items()
        }
    return {prefix.rstrip("."): tree}
