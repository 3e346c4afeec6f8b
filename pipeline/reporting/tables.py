"""A table once, printed as Markdown, LaTeX, HTML or JSON."""

import html
import json
from collections.abc import Sequence
from dataclasses import dataclass, field

_LATEX_SPECIAL = {"%": r"\%", "_": r"\_", "&": r"\&", "#": r"\#", "±": r"$\pm$", "Δ": r"$\Delta$", "−": "-"}


@dataclass(frozen=True)
class Table:
    """A titled table of already formatted cells.

    Attributes:
        title: One line that says what the figures are and over how many trials.
        columns: Column headings.
        rows: Cells, each row as long as `columns`.
        notes: Footnotes.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(
                    f"{self.title}: a row has {len(row)} cells, the table {len(self.columns)} columns: {row}"
                )

    def markdown(self) -> str:
        """The table as GitHub-flavoured Markdown."""
        lines = [f"**{self.title}**", "", _bar(self.columns), _bar(["---"] * len(self.columns))]
        lines += [_bar(row) for row in self.rows]
        lines += ["", *self.notes] if self.notes else []
        return "\n".join(lines) + "\n"

    def latex(self) -> str:
        """The table as a LaTeX `table` with booktabs, as the paper prints its own."""
        body = [r" & ".join(map(_latex, row)) + r" \\" for row in self.rows]
        return "\n".join(
            [
                r"\begin{table}",
                r"\centering",
                rf"\caption{{{_latex(self.title)}}}",
                rf"\begin{{tabular}}{{{'l' * len(self.columns)}}}",
                r"\toprule",
                r" & ".join(map(_latex, self.columns)) + r" \\ \midrule",
                *body,
                r"\bottomrule",
                r"\end{tabular}",
                *(rf"\par\footnotesize {_latex(note)}" for note in self.notes),
                r"\end{table}",
                "",
            ]
        )

    def html(self) -> str:
        """The table as an HTML fragment."""
        head = "".join(f"<th>{html.escape(cell)}</th>" for cell in self.columns)
        body = "".join(
            "<tr>" + "".join(f"<td>{_html(cell)}</td>" for cell in row) + "</tr>" for row in self.rows
        )
        notes = "".join(f"<p class='note'>{html.escape(note)}</p>" for note in self.notes)
        caption = html.escape(self.title)
        return (
            f"<div class='table'><table><caption>{caption}</caption><thead><tr>{head}</tr></thead>"
            f"<tbody>{body}</tbody></table>{notes}</div>"
        )

    def json(self) -> str:
        """The table as JSON, one object per row."""
        content = {
            "title": self.title,
            "rows": [dict(zip(self.columns, row, strict=True)) for row in self.rows],
            "notes": list(self.notes),
        }
        return json.dumps(content, ensure_ascii=False, indent=1) + "\n"


def mean_and_deviation(values: Sequence[float], digits: int = 2) -> str:
    """`mean ± standard deviation` over independent seeds, as the paper prints it; one value stands alone."""
    mean = sum(values) / len(values)
    if len(values) == 1:
        return f"{mean:.{digits}f}"
    deviation = (sum((value - mean) ** 2 for value in values) / (len(values) - 1)) ** 0.5
    return f"{mean:.{digits}f} ± {deviation:.{digits}f}"


def _bar(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def _html(cell: str) -> str:
    """A cell as HTML; `**…**` is bold."""
    bold = cell.removeprefix("**").removesuffix("**")
    return html.escape(cell) if bold == cell else f"<b>{html.escape(bold)}</b>"


def _latex(text: str) -> str:
    return "".join(_LATEX_SPECIAL.get(character, character) for character in text)
