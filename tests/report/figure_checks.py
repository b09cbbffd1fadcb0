"""What a figure shows: its words, and whether an axis without data pretends to have a scale."""

import numpy as np


def words_of(figure):
    """All words in and above the panels."""
    texts = [text.get_text() for axis in figure.axes for text in axis.texts]
    return " ".join([*texts, *(axis.get_title("left") for axis in figure.axes),
                     figure.get_suptitle()])


def has_data(axis):
    """Whether something is drawn at places of its own, not a line or band across the panel."""
    lines = [line for line in axis.lines if line.get_transform() == axis.transData]
    found = [np.asarray(line.get_xydata(), float) for line in lines]
    meshes = [np.ma.filled(np.ma.asarray(one.get_array(), float), np.nan)
              for one in axis.collections if one.get_array() is not None]
    segments = [segment for one in axis.collections if hasattr(one, "get_segments")
                for segment in one.get_segments()]
    return any(np.isfinite(one).all(axis=-1).any() for one in (*found, *segments) if len(one)) \
        or any(np.isfinite(one).any() for one in meshes)


def assert_no_invented_axes(figure):
    """A panel without data says so in words and numbers its upright axis nowhere."""
    for axis in figure.axes:
        if axis.get_label() == "<colorbar>" or has_data(axis) or axis.patches:
            continue
        twins = [one for one in figure.axes if one is not axis
                 and one.get_position().bounds == axis.get_position().bounds]
        if any(has_data(one) for one in twins):
            continue
        assert axis.texts, f"an empty panel says nothing: {axis.get_title('left')!r}"
        if any(has_data(one) for one in axis.get_shared_y_axes().get_siblings(axis)):
            continue
        numbers = [label.get_text() for panel in (axis, *axis.child_axes)
                   for label in panel.get_yticklabels() if label.get_visible()]
        assert not any(numbers), (axis.get_title("left"), numbers)
