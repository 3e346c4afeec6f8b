"""The shortest manoeuvre that would tell two effects apart, or show one that these logs cannot show."""

from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.effects.catalogue import WITH_AN_EQUATION

PAIRS = {
    frozenset(
        ("gain", "sensor_bias")
    ): "drive {joint} slowly against both of its stops: a stop that reads elsewhere means the "
    "encoder, the same stops with another speed mean the actuator",
    frozenset(
        ("delay", "lag")
    ): "give {joint} ten starts and stops, each held for 2 s: a delay shifts the whole rise, a lag stretches it",
    frozenset(
        ("delay", "stiction")
    ): "start {joint} after rests of 0.2, 1 and 5 s, and reverse it without rest: stiction delays only "
    "starts after rest",
    frozenset(
        ("lag", "stiction")
    ): "start {joint} after rests of 0.2, 1 and 5 s, and stop it from full speed: stiction leaves stops as "
    "they were, a lag does not",
    frozenset(
        ("backlash", "stiction")
    ): "start {joint} five times in the same direction after rests, then reverse it five times: backlash "
    "shows after reversals only",
    frozenset(
        ("gain", "load")
    ): "move {joint} through its range with the other joints stretched, then folded: a load's influence changes "
    "with the pose, a gain does not",
    frozenset(
        ("gain", "thermal_drift")
    ): "let the machine stand for an hour, then repeat the same move of {joint} every minute for ten minutes",
    frozenset(
        ("gain", "leakage")
    ): "let {joint} rest for 20 s in two poses, then move it at full command both ways",
}


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
        sentence = PAIRS.get(frozenset(families[:2]))
        if sentence is None:
            sentence = (
                " and ".join(
                    WITH_AN_EQUATION[f].card.excitation for f in families[:2] if f in WITH_AN_EQUATION
                )
                + " (on {joint})"
            )
        return sentence.format(joint=joint).capitalize() + "."
    if verdict in ("named", "outside_catalogue") and families and families[0] in WITH_AN_EQUATION:
        return f"To narrow the interval: {WITH_AN_EQUATION[families[0]].card.excitation}."
    if verdict == "outside_catalogue" and families and families[0] == COURSE:
        return f"Repeat the same move of {joint} every few seconds for ten minutes, with nothing else moving."
    if verdict == "outside_catalogue":
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
