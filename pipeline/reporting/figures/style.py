"""The common style of all figures, and their export to bytes.

Colours are those of Okabe and Ito (Color Universal Design, 2008), which differ under the common colour-vision
deficiencies; quantities have perceptually uniform colour maps. Bytes depend on the data alone (no dates, no random
identifiers), so that unchanged results leave unchanged files.
"""

import io
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

INK = "#1b2733"
MEASURED = INK  # measurements beside predictions
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # Okabe and Ito, without yellow
SERIES_DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 2)))  # readable without colour
SEQUENTIAL_MAP = "viridis"
DIVERGING_MAP = "managua"
REGION = "#8a97a3"  # limits and workspaces
DOTS_PER_INCH = 150

_SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.edgecolor": REGION,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e8ed",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "svg.hashsalt": "pipeline",
    "svg.fonttype": "path",
    "figure.constrained_layout.use": True,
}


class StyledFigure:
    """A Matplotlib figure in the common style, outside pyplot's global state.

    It is a context manager: the style holds inside it.
    """

    def __init__(self, width_in: float, height_in: float) -> None:
        self._context = mpl.rc_context(_SETTINGS)
        self._size = (width_in, height_in)

    def __enter__(self) -> Figure:
        """Opens the style and an empty figure."""
        self._context.__enter__()
        figure = Figure(figsize=self._size)
        FigureCanvasAgg(figure)
        return figure

    def __exit__(self, *error: object) -> None:
        """Restores Matplotlib's settings."""
        self._context.__exit__(None, None, None)


def series_style(index: int) -> dict[str, Any]:
    """Colour and dashes of the series with this index; they repeat after six."""
    return {"color": SERIES[index % len(SERIES)], "linestyle": SERIES_DASHES[index % len(SERIES_DASHES)]}


def frameless(axes: Axes) -> None:
    """Removes grid and spines, for pictures of space or matrices."""
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)


def to_svg(figure: Figure) -> bytes:
    """The figure as SVG; inside its `StyledFigure` context."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def to_png(figure: Figure) -> bytes:
    """The figure as PNG, for many thousands of marks; inside its `StyledFigure` context."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
    return buffer.getvalue()
