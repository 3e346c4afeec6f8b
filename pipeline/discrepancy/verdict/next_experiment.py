"""What to record next, in a sentence: where no experiment could be planned, or none has to be."""

from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.effects.catalogue import WITH_AN_EQUATION


def next_experiment(verdict: str, families: list[str], joint: str | None, idle: list[str]) -> str:
    """One sentence: what to record next.

    Args:
        verdict: As in the contract.
        families: Keys of the cards: the effect first, then its equivalents.
        joint: Where.
        idle: Joints that hardly move in the logs.
    """
    moves = f"move {', '.join(idle)} for at least a minute each, in both directions" if idle else ""
    if verdict == "unexcited":
        return f"Record logs in which the joints are excited: {moves}." if moves else "Record longer logs."
    if verdict == "ambiguous" and len(families) > 1:
        told = [WITH_AN_EQUATION[f].card.excitation for f in families[:2] if f in WITH_AN_EQUATION]
        if told:
            return f"{' and '.join(told)} (on {joint}).".capitalize()
    if verdict in ("named", "outside_catalogue") and families and families[0] in WITH_AN_EQUATION:
        return f"To narrow the interval: {WITH_AN_EQUATION[families[0]].card.excitation}."
    if verdict == "outside_catalogue" and families and families[0] == COURSE:
        return f"Repeat the same move of {joint} every few seconds for ten minutes, with nothing else moving."
    if verdict in ("outside_catalogue", "ambiguous"):
        return (
            f"Repeat the same move of {joint} while only what it depends on changes, in five steps of its "
            "range."
        )
    if verdict == "named":
        return "Log the supply's pressure or the engine's speed beside the joints while several of them move."
    return (
        f"Nothing was found. For joints that hardly moved: {moves}."
        if moves
        else "None needed: nothing was found."
    )
