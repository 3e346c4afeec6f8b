"""Named tuples of numbers and arrays as NumPy records, which compiled code takes as one pointer.

Passing the tuples themselves would copy every array's header at each call and count its references: measured
ten times the cost of the arithmetic.
"""

from typing import NamedTuple

import numpy as np


def record_type(values: NamedTuple) -> np.dtype:
    """Record type with one field per field of `values`; nested tuples become nested records."""
    fields: list[tuple] = []
    for name, value in zip(values._fields, values, strict=True):
        if hasattr(value, "_fields"):
            fields.append((name, record_type(value)))
        else:
            array = np.asarray(value)
            fields.append((name, array.dtype, array.shape) if array.ndim else (name, array.dtype))
    return np.dtype(fields, align=True)


def pack(values: NamedTuple) -> np.recarray:
    """One record, shape (1,), with a copy of all values."""
    record = np.zeros(1, dtype=record_type(values))
    _fill(record, values)
    return record.view(np.recarray)


def _fill(record: np.ndarray, values: NamedTuple) -> None:
    for name, value in zip(values._fields, values, strict=True):
        if hasattr(value, "_fields"):
            _fill(record[name], value)
        else:
            record[name][0] = value
