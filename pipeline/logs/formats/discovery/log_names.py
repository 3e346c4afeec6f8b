"""Names of logs: unique over all logs of a folder, together with those of their trajectories."""

import itertools
from collections import Counter
from pathlib import Path


def unique_names(logs: list[tuple[str, Path]], directory: Path) -> list[str]:
    """Return a name for each log: its own if no other log or trajectory has it, otherwise one made from its path.

    The second trajectory of the log `run` is called `run#1`, so a log of that name beside `run` is renamed too.

    Args:
        logs: Each log's own name and its path below the folder.
    """
    counts = Counter(name for name, _ in logs)
    kept = {name for name, count in counts.items() if count == 1 and _log_of_trajectory(name) not in counts}
    taken = set(kept)
    names = []
    for own, path in logs:
        name = own
        if own not in kept:
            longer = _longer_name(own, path.relative_to(directory))
            numbered = itertools.chain([longer], (f"{longer}_{number}" for number in itertools.count(2)))
            used = taken | {_log_of_trajectory(other) for other in taken}
            name = next(one for one in numbered if one not in used)
            taken.add(name)
        names.append(name)
    return names


def _log_of_trajectory(name: str) -> str | None:
    """Return the log whose trajectory would have this name; None if no trajectory is named like this."""
    log, mark, number = name.rpartition("#")
    return log if mark and number.isdecimal() else None


def _longer_name(name: str, path: Path) -> str:
    """Join a log's folders, its name and its suffixes, without `#`."""
    behind = path.name.partition(name)[2] if path.name.startswith(name) else ""
    return "_".join((*path.parts[:-1], name + behind.replace(".", "_"))).replace("#", "_")
