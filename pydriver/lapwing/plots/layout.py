"""Places of the panels of a figure: what is written around them is measured once.

Matplotlib's constrained layout measures everything twice and took half of the drawing time.  Here
panels stand in rows and columns; each row and column gives its edges the room that its widest
labels need, the heading and the legend stand above and below.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import LayoutEngine

# Mark (gid) of words above a panel, for which room is made.
ABOVE = "above"
# Inches between panels and around them, below a heading, and the least size of a panel.
GAP, EDGE, LEAST, HALF_NUMBER = 0.12, 0.08, 0.3, 0.15
# So few panels are measured twice.
FEW = 2
# Where panels stand before anything is measured, in inches: close to what comes out.
GUESS_LEFT, GUESS_RIGHT, GUESS_TOP, GUESS_BOTTOM, GUESS_BETWEEN = 0.85, 0.75, 0.75, 0.85, 0.4


def rows() -> LayoutEngine:
    """Layout of `figure.subplots`: rows and columns, with second scales, heading and legend."""
    from matplotlib.layout_engine import LayoutEngine

    class Rows(LayoutEngine):
        """Places the panels at each drawing."""

        _adjust_compatible = False
        _colorbar_gridspec = False

        def execute(self, fig: Figure) -> None:
            """Give all panels their places."""
            place(fig)

    return Rows()


def place(fig: Figure) -> None:
    """Give all panels of a figure their places."""
    panels = [axis for axis in fig.axes if axis.get_subplotspec() is not None]
    if not panels:
        return
    width, height = fig.get_size_inches()
    above, below = _heading(fig, height), _legend(fig, height)
    grid: Any = panels[0].get_subplotspec().get_gridspec()  # type: ignore[union-attr]
    tall = np.array(grid.get_height_ratios(), float)
    wide = np.array(grid.get_width_ratios() or [1.0] * grid.ncols, float)
    places = [(axis, axis.get_subplotspec().rowspan.start,  # type: ignore[union-attr]
               axis.get_subplotspec().colspan.start)  # type: ignore[union-attr]
              for axis in panels]
    room = np.zeros((4, max(grid.nrows, grid.ncols)))
    room[0], room[1], room[2] = GUESS_LEFT, GUESS_RIGHT, GUESS_BETWEEN
    room[3, grid.nrows - 1] = GUESS_BOTTOM
    renderer = fig._get_renderer()  # type: ignore[attr-defined]
    # Few panels change more of their size, and with it their numbers, than the guess foresees.
    for _ in range(2 if len(panels) <= FEW else 1):
        _stand(places, room, tall, wide, (width, height), (above, below))
        room = np.zeros_like(room)
        for axis, row, column in places:
            left, right, top, bottom = np.array(_around(axis, renderer)) / fig.dpi
            for side, at, need in ((0, column, left), (1, column, right), (2, row, top),
                                   (3, row, bottom)):
                room[side, at] = max(room[side, at], need)
    _stand(places, room, tall, wide, (width, height), (above, below))


def _heading(fig: Figure, height: float) -> float:
    """Put the heading at the top; inches it takes."""
    heading = fig._suptitle  # type: ignore[attr-defined]
    if heading is None or not heading.get_text():
        return EDGE
    heading.set(y=1 - EDGE / height, verticalalignment="top")
    tall: float = heading.get_window_extent().height
    return tall / fig.dpi + EDGE + GAP


def _legend(fig: Figure, height: float) -> float:
    """Put the legend at the bottom; inches it takes."""
    taken = EDGE
    for legend in fig.legends:
        legend.set_bbox_to_anchor((0, EDGE / height, 1, 1))
        legend.borderaxespad = 0
        taken += legend.get_window_extent().height / fig.dpi + GAP
    return taken


def _around(axis: Axes, renderer: Any) -> tuple[float, float, float, float]:
    """Pixels that words and numbers take left of a panel, right of, above and below it."""
    from matplotlib.transforms import Bbox

    inside = axis.bbox
    boxes = []
    for one in (axis, *axis.child_axes):
        locate = one.get_axes_locator()
        if locate is not None:  # a second scale stands where its panel is, once it is asked
            one.apply_aspect(locate(one, renderer))
        for scale in (one.xaxis, one.yaxis):
            found = scale.get_tightbbox(renderer) if one.axison else None
            if found is not None:
                # A label may be longer than its panel; only across the axis it needs room.
                boxes.append(Bbox([[found.x0, inside.y0], [found.x1, inside.y1]])
                             if scale.axis_name == "y" else
                             Bbox([[inside.x0, found.y0], [inside.x1, found.y1]]))
    above = [text for text in axis.texts if text.get_gid() == ABOVE]
    for title in (axis._left_title, *above):  # type: ignore[attr-defined]
        if title.get_text():
            top = title.get_window_extent(renderer).y1
            boxes.append(Bbox([[inside.x0, inside.y1], [inside.x1, top]]))
    if not boxes:
        return 0.0, 0.0, 0.0, 0.0
    around = Bbox.union(boxes)
    # Numbers at the ends of the lower axis stand half beyond it.
    least = HALF_NUMBER * axis.figure.dpi
    return (max(inside.x0 - around.x0, least), max(around.x1 - inside.x1, least),
            max(around.y1 - inside.y1, 0), max(inside.y0 - around.y0, 0))


def _stand(places: Any, room: Any, tall: Any, wide: Any, size: tuple[float, float],
           outer: tuple[float, float]) -> None:
    """Give panels their places.

    `room` has a row each for what is needed left, right (by column), above and below (by row);
    `outer` are the inches above and below all of them.
    """
    width, height = size
    left, right = room[0, :wide.size], room[1, :wide.size]
    top, bottom = room[2, :tall.size], room[3, :tall.size]
    free = max(width - 2 * EDGE - left.sum() - right.sum() - GAP * (wide.size - 1),
               LEAST * wide.size)
    widths = free * wide / wide.sum()
    free = max(height - sum(outer) - top.sum() - bottom.sum() - GAP * (tall.size - 1),
               LEAST * tall.size)
    heights = free * tall / tall.sum()
    x = EDGE + np.cumsum(left) + np.concatenate([[0], np.cumsum(widths + right + GAP)[:-1]])
    y = height - outer[0] - np.cumsum(top) - np.cumsum(heights) \
        - np.concatenate([[0], np.cumsum(bottom + GAP)[:-1]])
    for axis, row, column in places:
        axis.set_position((x[column] / width, y[row] / height, widths[column] / width,
                           heights[row] / height))
