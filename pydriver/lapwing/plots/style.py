"""What all figures share: palette, type, units, second scales, saving."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path

import numpy as np

from lapwing.codes import MotionState

# Okabe and Ito's palette: told apart by colour-blind readers and by lightness in grey.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
# What somebody else reports: a darker purple for small print.
CLAIM, CLAIM_TEXT = PURPLE, "#8F3F6E"
WALL, QUIET = "0.35", "0.4"

START_STYLES = {
    "rest": {"color": BLACK, "size": 0.8, "alpha": 0.45, "label": "each from rest"},
    "up": {"color": VERMILION, "size": 1.8, "alpha": 0.7, "label": "carried upwards"},
    "down": {"color": SKY, "size": 2.8, "alpha": 0.7, "label": "carried downwards"},
}
# Drawn in this order, the large markers first, so that branches that coincide are all seen.
DRAWING_ORDER = ("down", "up", "rest")

STATE_STYLES = {
    MotionState.SEPARATION: {"color": SKY, "linewidth": 1.1, "label": "separation"},
    MotionState.ENGAGEMENT: {"color": VERMILION, "linewidth": 2.0, "label": "engagement"},
    MotionState.BACK_ENGAGEMENT: {"color": BLACK, "linewidth": 2.0, "label": "back engagement"},
}

URAD = 1e6
# Values mostly below this part of the largest would be a flat line on a linear axis.
SMALL = 0.03
ARCSEC_PER_URAD = math.degrees(1) * 3600 * 1e-6

DPI = 170
RC = {
    "font.size": 9.5, "axes.titlesize": 10, "axes.titlelocation": "left",
    "figure.titlesize": 11.5, "axes.grid": True, "grid.color": "0.92", "grid.linewidth": 0.6,
    "axes.axisbelow": True, "axes.formatter.useoffset": False, "legend.framealpha": 0.95,
    "legend.fontsize": 8.5, "pdf.fonttype": 42, "lines.solid_capstyle": "butt",
    "agg.path.chunksize": 20000, "savefig.dpi": DPI,
}


@contextlib.contextmanager
def house_style():
    """The settings of all figures, whatever the reader's own are; also a decorator."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(RC)
        yield


def new_figure(width, height):
    """An empty figure (inches) that belongs to no window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


@house_style()
def save(figure, path):
    """Write a figure; the format follows from the name.  Nothing in the file tells the time.

    The places of the panels are worked out once, so that all formats show the same.
    """
    path = Path(path)
    metadata = {".png": {"Software": None}, ".pdf": {"CreationDate": None, "Producer": None}}
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        # With any engine left, even an idle one, saving draws everything twice.
        figure.set_layout_engine(None)
    figure.savefig(path, dpi=DPI, metadata=metadata.get(path.suffix))


def second_scale(axis, side, factor, label):
    """A scale at the opposite side ('right' or 'top') that reads `factor` times the first."""
    make = axis.secondary_yaxis if side == "right" else axis.secondary_xaxis
    scale = make(side, functions=(lambda x: x * factor, lambda x: x / factor))
    (scale.set_ylabel if side == "right" else scale.set_xlabel)(label)
    scale.minorticks_off()
    return scale


def arcsec_scale(axis):
    """Arc seconds at the right of an axis in µrad, whose limits are final if it is symlog."""
    if axis.get_yscale() != "symlog":
        return second_scale(axis, "right", ARCSEC_PER_URAD, "(arcsec)")
    # A secondary axis knows linear and logarithmic parents only.
    low, high = axis.get_ylim()
    scale = axis.twinx()
    scale.set_yscale("symlog", linthresh=axis.yaxis.get_transform().linthresh * ARCSEC_PER_URAD)
    scale.set_ylim(low * ARCSEC_PER_URAD, high * ARCSEC_PER_URAD)
    scale.set_ylabel("(arcsec)")
    scale.grid(False)
    return scale


def widen_small_values(axis, values):
    """Make an axis symmetric-logarithmic where most values are tiny beside the largest.

    Returns
    -------
    bool, whether it was done; the linear part then ends at a power of ten, a tenth of the median.
    """
    size = np.abs(values[np.isfinite(values)])
    size = size[size > 0]
    if size.size == 0 or np.median(size) > SMALL * size.max():
        return False
    axis.set_yscale("symlog", linthresh=10.0 ** np.floor(np.log10(np.median(size) / 2)))
    return True


def speed_unit(gear_pair):
    """Factor from rad per τ, its unit, and mm/s at the tooth per that unit (None: unknown)."""
    if gear_pair is None:
        return URAD, "µrad per τ", None
    return (float(gear_pair["natural_frequency"]), "rad/s",
            1e3 * float(gear_pair["pinion_base_lever"]))


def speed_scale(axis, millimetres):
    """Speed along the normal at the right of an axis in rad/s, where the lever is known."""
    if millimetres is not None:
        second_scale(axis, "right", millimetres, "along the normal (mm/s)")


def note(axis, text, y=0.5):
    """A sentence where there is nothing to draw, or where it must be said."""
    axis.text(0.5, y, text, transform=axis.transAxes, ha="center", va="center", color=QUIET,
              fontsize=11)


def describe(response):
    """Two lines on a response: torque; motion, or that the run failed."""
    attrs = response.attrs
    head = str(attrs["name"])
    if "brake_torque" in attrs:
        head += f": braking torque {float(attrs['brake_torque']):g} N·m"
    return f"{head}\n{motion(attrs)}"


def motion(attrs):
    """The motion in words."""
    if int(attrs["status"]):
        return f"the run failed ({str(attrs['status_meaning']).replace('_', ' ')})"
    if int(attrs.get("fully_engaged", 0)):
        return "engaged throughout"
    period = int(attrs["period"])
    words = f"period {period}" if period else "no period found"
    impacts = float(attrs.get("impacts_per_cycle", math.nan))
    if math.isfinite(impacts):
        threshold = 100 * float(attrs["count_depth"])
        words += (f", {impacts:.3g} {'impact' if impacts == 1 else 'impacts'} per cycle "
                  f"(flights deeper than {threshold:g} %)")
    return words


def failed(response):
    """Whether a response holds nothing but its status."""
    return bool(int(response.attrs["status"]))
