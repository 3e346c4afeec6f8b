"""The library of manoeuvres: what an operator can do with the sticks to make one effect show and another not.

Times are those of the machine. `rise_s` is the diagnosis model's memory of commands: after so long under a command,
speeds are steady. Rests lie on both sides of the rests that the card of stiction tries.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

RESTS_S = (0.2, 1.0, 4.0)
STANDING_S = 10.0  # for creep: long beside the time that a joint takes to come to rest
SHARE_OF_WAY = 0.8  # of the way that is free, a sweep takes
HALF = 0.5  # command of machines that know more than on and off
TRIES = 3  # starts of one kind within a manoeuvre


class Place(NamedTuple):
    """Where a joint can be moved.

    Attributes:
        q: (n_joint,) configuration, rad (m).
        joint: The joint that has its free way here.
        below: Its free way downwards, rad (m).
        above: Upwards.
    """

    q: np.ndarray
    joint: int
    below: float
    above: float


class Manoeuvre(NamedTuple):
    """Commands from rest in one configuration.

    Attributes:
        name: In words.
        q: (n_joint,) where it begins, rad (m).
        commands: Each (n_joint,) with its seconds.
    """

    name: str
    q: np.ndarray
    commands: list[tuple[np.ndarray, float]]

    @property
    def seconds(self) -> float:
        """In all."""
        return sum(seconds for _, seconds in self.commands)

    @property
    def motion_s(self) -> float:
        """In which a joint is commanded."""
        return sum(seconds for command, seconds in self.commands if command.any())

    def rows(self, n_rows: int, dt_s: float) -> np.ndarray:
        """(n_rows, n_joint) its commands, zero after its end."""
        counts = [round(seconds / dt_s) for _, seconds in self.commands]
        held = np.repeat([command for command, _ in self.commands], counts, axis=0)
        return np.pad(held, ((0, n_rows - len(held)), (0, 0)))


def manoeuvres_at(
    place: Place, joint_name: str, speed: np.ndarray, rise_s: float, is_switched: bool
) -> Iterator[Manoeuvre]:
    """Manoeuvres of the joint whose way is free at a place.

    Args:
        place: Where.
        joint_name: Of the joint.
        speed: (n_joint,) usual speeds, rad/s (m/s).
        rise_s: After which speeds are steady.
        is_switched: Whether commands are on or off alone.
    """
    n, joint = len(place.q), place.joint
    unit = np.eye(n)[joint]
    rest = (np.zeros(n), rise_s)
    for sign, way in ((1.0, place.above), (-1.0, place.below)):
        if way <= 0.0:
            continue
        there, back = sign * unit, -sign * unit
        said = f"{joint_name} {'up' if sign > 0 else 'down'}"
        short = min(rise_s, SHARE_OF_WAY * way / speed[joint])
        long = SHARE_OF_WAY * way / speed[joint]
        starts = [(there, short), rest, (back, short), rest]
        yield Manoeuvre(f"starts and stops, {said}", place.q, starts * TRIES)
        after_rests = [
            of
            for wait in RESTS_S
            for of in ((there, short), (np.zeros(n), wait), (back, short), (np.zeros(n), wait))
        ]
        yield Manoeuvre(f"starts after different rests, {said}", place.q, after_rests)
        reversals = [(there, short), (back, short)] * TRIES
        yield Manoeuvre(f"reversals without a rest, {said}", place.q, [*reversals, rest])
        same_way = [(there, short / TRIES), rest] * TRIES
        yield Manoeuvre(f"starts the same way, {said}", place.q, [*same_way, (back, short), rest])
        yield Manoeuvre(f"long move and back, {said}", place.q, [(there, long), rest, (back, long), rest])
        if not is_switched:
            at_half = [(HALF * there, long / HALF), rest, (HALF * back, long / HALF), rest]
            yield Manoeuvre(f"long move at half command, {said}", place.q, at_half)
        for other in range(n):
            if other != joint:
                both = there + np.eye(n)[other], back - np.eye(n)[other]
                pair = [
                    (both[0], short),
                    rest,
                    (both[1], short),
                    rest,
                    (there, short),
                    rest,
                    (back, short),
                    rest,
                ]
                yield Manoeuvre(f"with another joint and alone, {said}", place.q, pair)
    yield Manoeuvre(f"standing, {joint_name}", place.q, [(np.zeros(n), STANDING_S)])


def to_a_stop(
    place: Place, joint_name: str, limits: tuple[float, float], speed: float, rise_s: float
) -> Iterator[Manoeuvre]:
    """The joint against a stop that lies within its free way, and back."""
    n, joint = len(place.q), place.joint
    unit, rest = np.eye(n)[joint], (np.zeros(n), rise_s)
    q = place.q[joint]
    for sign, distance, way in (
        (1.0, limits[1] - q, place.above),
        (-1.0, q - limits[0], place.below),
    ):
        if distance <= way:
            there, back = (sign * unit, distance / speed + rise_s), (-sign * unit, distance / speed)
            side = "upper" if sign > 0 else "lower"
            yield Manoeuvre(f"{joint_name} against its {side} stop", place.q, [there, rest, back, rest])
