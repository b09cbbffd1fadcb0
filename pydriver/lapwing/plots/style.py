"""What all figures share: palette, type, units, second scales, saving."""

from __future__ import annotations

import contextlib
import io
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lapwing.base.arrivals import arrivals_in
from lapwing.base.codes import MotionState
from lapwing.plots import typeface

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette: told apart by colour-blind readers and by lightness in grey.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE, YELLOW = "#0072B2", "#D55E00", "#CC79A7", "#F0E442"
# What somebody else reports: a darker purple for small print.
CLAIM, CLAIM_TEXT = PURPLE, "#8F3F6E"
WALL, QUIET = "0.35", "0.4"

# The branch from rest lies below, wide; the others are drawn over it where they differ from it.
START_STYLES = {
    "rest": {"color": BLACK, "size": 1.6, "alpha": 0.45, "width": 2.0, "label": "each from rest"},
    # Ever thinner: what lies under another is seen on its sides.
    "up": {"color": VERMILION, "size": 1.6, "alpha": 0.7, "width": 1.6,
           "label": "carried upwards"},
    "down": {"color": SKY, "size": 1.6, "alpha": 0.7, "width": 0.9,
             "label": "carried downwards"},
}
DRAWING_ORDER = ("rest", "up", "down")
STATE_STYLES: dict[MotionState, dict[str, Any]] = {
    MotionState.SEPARATION: {"color": SKY, "linewidth": 1.1, "label": "separation"},
    MotionState.ENGAGEMENT: {"color": VERMILION, "linewidth": 2.0, "label": "engagement"},
    MotionState.BACK_ENGAGEMENT: {"color": BLACK, "linewidth": 2.0, "label": "back engagement"},
}

URAD = 1e6
# Values mostly below this part of the largest would be a flat line on a linear axis.
SMALL = 0.05
# Decades that the linear part of such an axis takes, on either side.
LINEAR = 0.4
# Powers of ten on either side of it that are numbered.
NUMBERS = 8
ARCSEC_PER_URAD = math.degrees(1) * 3600 * 1e-6

# Points of a line or marker above which a PDF shows pixels in its place.
MANY = 5000
RAISED = str.maketrans("0123456789−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")

DPI = 170
RC = {
    "font.size": 9.5, "axes.titlesize": 10, "axes.titlelocation": "left",
    "figure.titlesize": 11.5, "axes.grid": True, "grid.color": "0.92", "grid.linewidth": 0.6,
    "axes.axisbelow": True, "axes.formatter.useoffset": False,
    # A power of ten in the corner would lie on the title.
    "axes.formatter.limits": (-8, 7), "legend.framealpha": 0.95,
    "legend.fontsize": 8.5, "pdf.fonttype": 42, "lines.solid_capstyle": "butt",
    "agg.path.chunksize": 20000, "savefig.dpi": DPI,
    # A fixed place for titles: the search for a free one measures every tick label over again.
    "axes.titley": 1.0,
}
# What a scale at the top of a panel takes of the room below the title: ticks, numbers, label.
TOP_SCALE_POINTS = 34


@contextlib.contextmanager
def house_style() -> Iterator[None]:
    """The settings of all figures, whatever the reader's own are; also a decorator."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        settings: Any = RC | {"font.family": typeface.families()}
        matplotlib.rcParams.update(settings)
        yield


def new_figure(width: float, height: float, rows: bool = False) -> Figure:
    """An empty figure (inches) that belongs to no window.

    `rows`: for panels of one `figure.subplots` without colour bars, which are placed faster.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from lapwing.plots import layout

    figure = Figure(figsize=(width, height), dpi=DPI,
                    layout=layout.rows() if rows else "constrained")
    FigureCanvasAgg(figure)
    return figure


@house_style()
def save(figure: Figure, *paths: Any) -> None:
    """Write a figure in the formats its names end in.  Nothing in the files tells the time.

    The places of panels and labels are worked out once, so that all formats show the same.
    """
    if figure.get_suptitle():  # names of decks and files are the user's
        figure.suptitle(typeface.readable(figure.get_suptitle()))
    _place(figure)
    for path in sorted(map(Path, paths), key=lambda path: path.suffix != ".png"):
        if path.suffix == ".png":
            _save_png(figure, path)
        else:
            metadata = {"CreationDate": None, "Producer": None} if path.suffix == ".pdf" else None
            figure.savefig(path, dpi=DPI, metadata=metadata)


def _save_png(figure: Figure, path: Path | io.BytesIO) -> None:
    """Draw the pixels and write them without the alpha channel that they do not need."""
    from PIL import Image

    canvas: Any = figure.canvas  # Agg's, `new_figure`
    canvas.draw()
    # Level 3 costs half of the usual 6, for files a few per cent longer.
    Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").save(
        path, format="png", compress_level=3, dpi=(DPI, DPI))
    # What was just found holds for the next format.
    for axis in _panels(figure):
        for one in (axis.xaxis, axis.yaxis):
            middle = one.label.get_transform().transform(one.label.get_position())
            one.set_label_coords(*axis.transAxes.inverted().transform(middle))


@house_style()
def rehearse() -> None:
    """Draw a figure into nothing: what the first one loads and looks up is there for the next."""
    figure = new_figure(4, 3, rows=True)
    axis = figure.subplots()
    axis.plot([0, 1], [0, 1], label="rehearsal")
    axis.legend()
    axis.set_title("0123456789 −.")
    second_scale(axis, "right", 2, "twice")
    _place(figure)
    _save_png(figure, io.BytesIO())


def _place(figure: Figure) -> None:
    """Lay the figure out, once."""
    engine = figure.get_layout_engine()
    if engine is None:
        return
    for axis in _panels(figure):
        for spine in axis.spines.values():  # they lie on the edges, and are slow to say so
            spine.set_in_layout(False)
    engine.execute(figure)
    # With any engine left, even an idle one, saving draws everything twice.
    figure.set_layout_engine(None)


def _panels(figure: Figure) -> list[Any]:
    """All axes, second scales as well."""
    return [one for axis in figure.axes for one in (axis, *axis.child_axes)]


def second_scale(axis: Axes, side: str, factor: float, label: str) -> Axes:
    """A scale at the opposite side ('right' or 'top') that reads `factor` times the first."""
    make: Any = axis.secondary_yaxis if side == "right" else axis.secondary_xaxis
    scale: Axes = make(side, functions=(lambda x: x * factor, lambda x: x / factor))
    (scale.set_ylabel if side == "right" else scale.set_xlabel)(label)
    scale.minorticks_off()
    if side == "top":
        axis.set_title(axis.get_title("left"), pad=TOP_SCALE_POINTS)
    elif axis.get_yscale() == "log":
        plain_powers(scale.yaxis)
    return scale


def linear_to(axis: Axes) -> float:
    """Where the linear part of a symlog scale upwards ends."""
    scale: Any = axis.yaxis.get_transform()
    return float(scale.linthresh)


def upward_ticks(axis: Axes, **settings: Any) -> None:
    """How the numbers along the scale upwards are chosen, as `Locator.set_params` takes it."""
    locator: Any = axis.yaxis.get_major_locator()
    locator.set_params(**settings)


def arcsec_scale(axis: Axes) -> Axes:
    """Arc seconds at the right of an axis in µrad, whose limits are final if it is symlog."""
    if axis.get_yscale() != "symlog":
        return second_scale(axis, "right", ARCSEC_PER_URAD, "(arcsec)")
    # A secondary axis knows linear and logarithmic parents only.
    low, high = axis.get_ylim()
    scale = axis.twinx()
    scale.set_yscale("symlog", linscale=LINEAR,
                     linthresh=linear_to(axis) * ARCSEC_PER_URAD)
    upward_ticks(scale, numticks=NUMBERS)
    scale.set_ylim(low * ARCSEC_PER_URAD, high * ARCSEC_PER_URAD)
    plain_powers(scale.yaxis)
    scale.set_ylabel("(arcsec)")
    scale.grid(False)
    return scale


def plain_powers(axis: Any) -> None:
    """Powers of ten of a logarithmic `Axis` in raised figures: 10⁻³, with no TeX to be parsed."""
    from matplotlib.ticker import LogFormatterSciNotation

    class Plain(LogFormatterSciNotation):
        """The same labels as plain text."""

        def __call__(self, x: float, pos: int | None = None) -> str:
            words = super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")
            words = words.replace(r"\times", "×").replace("-", "−")
            return re.sub(r"\^\{(.*?)\}", lambda power: power[1].translate(RAISED), words)

    axis.set_major_formatter(Plain())
    if isinstance(axis.get_minor_formatter(), LogFormatterSciNotation):
        axis.set_minor_formatter(Plain())


def widen_small_values(axis: Axes, values: NDArray[Any]) -> bool:
    """Make an axis symmetric-logarithmic where most values are tiny beside the largest.

    Returns
    -------
    bool, whether it was done; the linear part then ends at a power of ten, a tenth of the median.
    """
    size = np.abs(values[np.isfinite(values)])
    size = size[size > 0]
    if size.size == 0 or np.median(size) > SMALL * size.max():
        return False
    axis.set_yscale("symlog", linthresh=10.0 ** np.floor(np.log10(np.median(size) / 2)),
                    linscale=LINEAR)
    upward_ticks(axis, numticks=NUMBERS)
    plain_powers(axis.yaxis)
    return True


def speed_unit(gear_pair: dict[str, float] | None) -> tuple[float, str, float | None]:
    """Factor from rad per τ, its unit, and mm/s at the tooth per that unit (None: unknown)."""
    if gear_pair is None:
        return URAD, "µrad per τ", None
    return (float(gear_pair["natural_frequency"]), "rad/s",
            1e3 * float(gear_pair["pinion_base_lever"]))


def speed_scale(axis: Axes, millimetres: float | None) -> None:
    """Speed along the normal at the right of an axis in rad/s, where the lever is known."""
    if millimetres is not None:
        second_scale(axis, "right", millimetres, "along the normal (mm/s)")


def note(axis: Axes, text: str, y: float = 0.5) -> None:
    """A sentence where there is nothing to draw, or where it must be said."""
    axis.text(0.5, y, text, transform=axis.transAxes, ha="center", va="center", color=QUIET,
              fontsize=11)


def nothing(axis: Axes, text: str, x: bool = False) -> None:
    """A panel without data: words in its place, and no numbers at its axes, made up as they were.

    `x`: at the lower axis as well; else it is another panel's, too.
    """
    axis.set_yticks([])
    if x:
        axis.set_xticks([])
    note(axis, text)


def describe(response: xr.Dataset) -> str:
    """Two lines on a response: torque; motion, or that the run failed."""
    attrs = response.attrs
    head = str(attrs["name"])
    if "brake_torque" in attrs:
        head += f": braking torque {float(attrs['brake_torque']):g} N·m"
    return f"{head}\n{motion(attrs)}"


def motion(attrs: dict[str, Any]) -> str:
    """The motion in words."""
    if int(attrs["status"]):
        return f"the run failed ({str(attrs['status_meaning']).replace('_', ' ')})"
    if int(attrs.get("fully_engaged", 0)):
        return "engaged throughout"
    period = int(attrs["period"])
    words = f"period {period}" if period else "no period found"
    impacts = float(attrs.get("impacts_per_cycle", math.nan))
    if math.isfinite(impacts):
        law, threshold = arrivals_in(attrs), 100 * float(attrs["count_depth"])
        words += f", {impacts:.3g} {law.word}{'s' * (impacts != 1)} per cycle"
        back = float(attrs.get("back_impacts_per_cycle", 0))
        words += f" and {back:.3g} on the coast flank" * (back > 0)
        words += f" (flights deeper than {threshold:g} %)" * law.threshold
    return words


def failed(response: xr.Dataset) -> bool:
    """Whether a response holds nothing but its status."""
    return bool(int(response.attrs["status"]))
