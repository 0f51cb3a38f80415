"""Draw pictures with matplotlib; equal pictures give equal bytes."""

import io
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """A drawn figure and the words of a page about it."""

    title: str
    caption: str = ""
    figure: Any  # a matplotlib Figure


def empty_figure(width_in: float, height_in: float) -> Any:
    """Return a figure that no global state of matplotlib knows of."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png_of(figure: Any) -> bytes:
    """Return a figure as PNG."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=130, metadata={"Software": None})
    return file.getvalue()


def svg_of(figure: Any) -> bytes:
    """Return a figure as SVG without a date."""
    import matplotlib as mpl

    file = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "karma"}):
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    return file.getvalue()
