"""A table with output as Markdown, LaTeX, HTML or JSON."""

import html
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

# LaTeX for characters that are markup or missing in its fonts; the longest match counts.
_LATEX = {
    "%": r"\%",
    "_": r"\_",
    "&": r"\&",
    "#": r"\#",
    "^": r"\^{}",
    "|": "$|$",
    "<": "$<$",
    ">": "$>$",
    "±": r"$\pm$",
    "×": r"$\times$",
    "−": "$-$",
    "–": "--",
    "²": "$^2$",
    "†": r"$^{\dagger}$",
    "‡": r"$^{\ddagger}$",
    "α": r"$\alpha$",
    "Δ": r"$\Delta$",
    "Δq": r"$\Delta\bm{q}$",
    "Δq̇": r"$\Delta\dot{\bm{q}}$",
    "OOW": r"OO$\mathcal{W}$",
    "OOZ": "OO$Z$",
    "W+": r"$\mathcal{W}^{+}$",
    "r^X": r"$r_t^{\mathcal{X}}$",
    "r^q": r"$r_t^{\bm{q}}$",
    "r^ε": r"$r_t^{\epsilon}$",
    "r^a": r"$r_t^{\bm{a}}$",
    "r^W": r"$r_t^{\mathcal{W}}$",
}
_LATEX_TOKEN = re.compile("|".join(re.escape(token) for token in sorted(_LATEX, key=len, reverse=True)))
_MINUS = re.compile(r"(?<![\w)])-(?=\d)")  # sign of a negative number, not a hyphen
_SUPERSCRIPT = re.compile(r"\^(\w)")


@dataclass(frozen=True)
class Table:
    """A titled table of already formatted cells.

    Attributes:
        title: One line: the figures and their number of trials.
        columns: Column headings.
        rows: Cells, each row as long as `columns`.
        notes: Footnotes.
        merged: Number of leading columns in which repeated cells are printed once; JSON repeats them.
        rules: Indices of the rows below a horizontal rule.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = field(default_factory=tuple)
    merged: int = 0
    rules: Sequence[int] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(
                    f"{self.title}: a row has {len(row)} cells, the table {len(self.columns)} columns: {row}"
                )

    def markdown(self) -> str:
        """The table as GitHub-flavoured Markdown."""
        lines = [f"**{self.title}**", "", _bar(self.columns), _bar(["---"] * len(self.columns))]
        lines += [_bar(row) for row in self._printed_rows()]
        lines += ["", *self.notes] if self.notes else []
        return "\n".join(lines) + "\n"

    def latex(self) -> str:
        """The table as a LaTeX `table` in the paper's form; it needs the packages booktabs and bm."""
        body = []
        for index, row in enumerate(self._printed_rows()):
            body += [r"\midrule"] if index in self.rules else []
            body.append(" & ".join(map(_latex, row)) + r" \\")
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
        head = "".join(f"<th>{_html(cell)}</th>" for cell in self.columns)
        body = "".join(
            ("<tr class='ruled'>" if index in self.rules else "<tr>")
            + "".join(f"<td>{_html(cell)}</td>" for cell in row)
            + "</tr>"
            for index, row in enumerate(self._printed_rows())
        )
        notes = "".join(f"<p class='note'>{_html(note)}</p>" for note in self.notes)
        caption = html.escape(self.title)
        return (
            f"<div class='table'><table><caption>{caption}</caption><thead><tr>{head}</tr></thead>"
            f"<tbody>{body}</tbody></table>{notes}</div>"
        )

    def write(self, directory: Path, name: str) -> None:
        """Write the table as Markdown, LaTeX and JSON."""
        directory.mkdir(parents=True, exist_ok=True)
        (directory / f"{name}.md").write_text(self.markdown(), encoding="utf-8")
        (directory / f"{name}.tex").write_text(self.latex(), encoding="utf-8")
        (directory / f"{name}.json").write_text(self.json(), encoding="utf-8")

    def json(self) -> str:
        """The table as JSON, one object per row."""
        content = {
            "title": self.title,
            "rows": [dict(zip(self.columns, row, strict=True)) for row in self.rows],
            "notes": list(self.notes),
        }
        return json.dumps(content, ensure_ascii=False, indent=1) + "\n"

    def _printed_rows(self) -> list[list[str]]:
        """Rows with repeated cells of the `merged` columns blanked; repetition restarts after a rule."""
        printed = []
        above: Sequence[str] = ()
        for index, row in enumerate(self.rows):
            same = 0
            if above and index not in self.rules:
                while same < self.merged and row[same] == above[same]:
                    same += 1
            printed.append([""] * same + list(row[same:]))
            above = row
        return printed


def mean_and_deviation(values: Sequence[float], digits: int = 2) -> str:
    """`mean ± standard deviation` over independent seeds, in the paper's form; one value has no deviation."""
    mean = sum(values) / len(values)
    if len(values) == 1:
        return f"{mean:.{digits}f}"
    deviation = (sum((value - mean) ** 2 for value in values) / (len(values) - 1)) ** 0.5
    return f"{mean:.{digits}f} ± {deviation:.{digits}f}"


def with_superscripts(text: str) -> str:
    """Text as HTML, with the character after `^` as a superscript."""
    return _SUPERSCRIPT.sub(r"<sup>\1</sup>", html.escape(text))


def _bar(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def _without_bold(cell: str) -> str:
    """The cell's text; `**…**` is bold."""
    return cell.removeprefix("**").removesuffix("**")


def _html(cell: str) -> str:
    """A cell as HTML; mean and deviation stay on one line."""
    bold = _without_bold(cell)
    text = with_superscripts(bold).replace(" ± ", "&#8239;±&#8239;")
    return text if bold == cell else f"<b>{text}</b>"


def _latex(cell: str) -> str:
    bold = _without_bold(cell)
    text = _LATEX_TOKEN.sub(lambda token: _LATEX[token.group()], _MINUS.sub("−", bold))
    return text if bold == cell else rf"\textbf{{{text}}}"
