"""Vectors and quaternions as tuples of their components, each a number or an array of any shape.

If quaternions and positions are arrays with a last axis of three or four numbers, XLA loops over those numbers. If
every component is an array, it makes one vectorised loop over all environments and ticks. Constant components, such as
most of a robot's geometry, are Python numbers, and zeros among them cost nothing.
"""

import math
from collections.abc import Sequence
from typing import Any

Number = Any  # a Python number, or an array of NumPy or JAX
Components = tuple[Number, ...]  # of a vector (x, y, z) or a quaternion (w, x, y, z)


def about(axis: Sequence[float], angle: Number, functions: Any = math) -> Components:
    """Unit quaternion of a turn about a unit vector by an angle in rad; `functions` has `sin` and `cos` for it."""
    return functions.cos(0.5 * angle), *scale(functions.sin(0.5 * angle), tuple(map(float, axis)))


def _sum_of_products(*pairs: tuple[Number, Number]) -> Number:
    total: Number = 0.0
    for a, b in pairs:
        if _is(a, 0.0) or _is(b, 0.0):
            continue
        product = b if _is(a, 1.0) else a if _is(b, 1.0) else a * b
        total = product if _is(total, 0.0) else total + product
    return total


def _is(value: Number, number: float) -> bool:
    return isinstance(value, float) and value == number


def scale(factor: Number, vector: Components) -> Components:
    """The vector times a number."""
    return tuple(_sum_of_products((factor, component)) for component in vector)


def add(a: Sequence[Number], b: Sequence[Number]) -> Components:
    """Sum of two vectors."""
    return tuple(_sum_of_products((x, 1.0), (y, 1.0)) for x, y in zip(a, b, strict=True))


def multiply(a: Components, b: Components) -> Components:
    """Hamilton product."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    _, nx, ny, nz = scale(-1.0, a)
    return (
        _sum_of_products((aw, bw), (nx, bx), (ny, by), (nz, bz)),
        _sum_of_products((aw, bx), (ax, bw), (ay, bz), (nz, by)),
        _sum_of_products((aw, by), (nx, bz), (ay, bw), (az, bx)),
        _sum_of_products((aw, bz), (ax, by), (ny, bx), (az, bw)),
    )


def rotate(rotation: Components, vector: Components) -> Components:
    """`vector` turned by a unit quaternion (w, u): v + 2 w (u x v) + 2 u x (u x v)."""
    w, *u = rotation
    twice = scale(2.0, cross(u, vector))
    return add(add(vector, scale(w, twice)), cross(u, twice))


def cross(a: Sequence[Number], b: Sequence[Number]) -> Components:
    """Vector product."""
    negative = scale(-1.0, tuple(a))
    return (
        _sum_of_products((a[1], b[2]), (negative[2], b[1])),
        _sum_of_products((a[2], b[0]), (negative[0], b[2])),
        _sum_of_products((a[0], b[1]), (negative[1], b[0])),
    )
