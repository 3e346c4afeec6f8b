"""The catalogue of effects as a Markdown table: `python -m pipeline.reporting.tables.effect_catalogue`."""

from collections.abc import Iterable

from pipeline.effects.catalogue import CATALOGUE
from pipeline.effects.effect import Card, Effect

COLUMNS = (
    "Family",
    "Equation",
    "Parameters",
    "What it leaves in the residual",
    "Looks like",
    "What shows it",
)
UNITS = {"1": "", "length": "rad or m", "speed": "rad/s or m/s"}


def catalogue_table(effects: Iterable[type[Effect]] = tuple(CATALOGUE.values())) -> str:
    """One row per card, in the catalogue's order."""
    rows = [COLUMNS, ("---",) * len(COLUMNS), *(_row(effect.card) for effect in effects)]
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |\n" for row in rows)


def _row(card: Card) -> tuple[str, ...]:
    parameters = [
        f"`{parameter.name}`" + (f" [{unit}]" if (unit := UNITS.get(parameter.unit, parameter.unit)) else "")
        for parameter in card.parameters
    ]
    alike = [f"`{family}`" for family in card.confounded_with]
    return (
        f"`{card.family}`",
        f"{card.equation} ({card.source})",
        ", ".join(parameters),
        card.signature,
        ", ".join(alike),
        card.excitation,
    )


if __name__ == "__main__":
    print(catalogue_table(), end="")
