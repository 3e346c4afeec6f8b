"""The report: one self-contained HTML page."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import resources

import jinja2
from markupsafe import Markup

from pipeline.reporting.table import Table, with_superscripts

PNG, SVG, WEBP = "image/png", "image/svg+xml", "image/webp"


@dataclass(frozen=True)
class Figure:
    """A picture with its caption; `content` is of the media type PNG, SVG or WEBP."""

    title: str
    caption: str
    content: bytes
    media_type: str

    @property
    def source(self) -> str:
        """The picture as a data URI, so that the page needs no other file."""
        return f"data:{self.media_type};base64,{base64.b64encode(self.content).decode()}"


@dataclass(frozen=True)
class Points:
    """A list of sentences under a heading; `folded` ones are closed at first."""

    title: str
    sentences: Sequence[str]
    folded: bool = False


@dataclass(frozen=True)
class Section:
    """A chapter of the page: a question, its answer in a sentence, the evidence.

    With `gallery` its pictures lie side by side; `folded_tables` are closed at first.
    """

    title: str
    answer: str
    figures: Sequence[Figure] = field(default_factory=tuple)
    tables: Sequence[Table] = field(default_factory=tuple)
    paragraphs: Sequence[str] = field(default_factory=tuple)
    points: Sequence[Points] = field(default_factory=tuple)
    gallery: bool = False
    folded_tables: Sequence[Table] = field(default_factory=tuple)


@dataclass(frozen=True)
class KeyFigure:
    """A headline figure."""

    value: str
    label: str


def render_page(
    title: str,
    verdict: str,
    key_figures: Sequence[KeyFigure],
    sections: Sequence[Section],
    provenance: Sequence[tuple[str, str]],
) -> str:
    """Lay out the page.

    Args:
        title: Heading of the page.
        verdict: What was done and how far to trust it, in one or two sentences.
        key_figures: The headline figures.
        sections: The chapters, in reading order.
        provenance: Names and values: commit, data hashes, configuration, runs.
    """
    template = resources.files("pipeline.reporting").joinpath("page.html.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["with_superscripts"] = _with_superscripts
    return environment.from_string(template).render(
        title=title, verdict=verdict, key_figures=key_figures, sections=sections, provenance=provenance
    )


def _with_superscripts(text: str) -> Markup:
    """Symbols such as r^X as HTML; HTML is left unchanged."""
    return text if isinstance(text, Markup) else Markup(with_superscripts(text))
