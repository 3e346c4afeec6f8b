"""Whether the dependence reported of an effect outside the catalogue is the true one."""

import enum
from collections.abc import Iterable

HARMLESS = ("command", "direction")  # of an affected joint itself: it only moves when it is commanded


class Dependence(enum.StrEnum):
    """How near a reported `depends_on` comes to the truth."""

    right = "right"  # names all of the truth and nothing that is wrong
    near = "near"  # the truth beside something wrong, or the true variable without its joint or with another
    wrong = "wrong"


def judge_dependence(truth: Iterable[str], reported: Iterable[str], joints: Iterable[str]) -> Dependence:
    """Compare `depends_on` entries.

    Args:
        truth: True entries, `variable` or `variable:joint`.
        reported: Reported ones.
        joints: The affected joints. Their own command or direction may stand beside the truth, and so may the
            direction of a true entry's joint.
    """
    true, told = set(truth), set(reported)
    allowed = {f"{variable}:{joint}" for variable in HARMLESS for joint in joints}
    allowed |= {f"direction:{joint}" for _, _, joint in (entry.partition(":") for entry in true) if joint}
    if true <= told and not told - true - allowed:
        return Dependence.right
    variables = {entry.partition(":")[0] for entry in true}
    beside = told - (allowed - true)
    if true & told or variables & {entry.partition(":")[0] for entry in beside}:
        return Dependence.near
    return Dependence.wrong
