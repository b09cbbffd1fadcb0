"""The main result of each study in one line."""

from __future__ import annotations

from lapwing.arrivals import arrivals_in
from lapwing.codes import Status
from lapwing.report.critical import headline


def headlines(responses, criticals, sweeps):
    """One line for each study.

    Parameters
    ----------
    responses : sequence of Dataset
    criticals, sweeps : dict of name -> Dataset

    Returns
    -------
    tuple of str
    """
    return (*(f"{one.attrs['name']}: {_response(one.attrs)}" for one in responses),
            *(f"{name}: {headline(critical)}" for name, critical in criticals.items()),
            *(f"{name}: {_sweep(sweep)}" for name, sweep in sweeps.items()))


def _response(attrs):
    if attrs["status"]:
        return f"failed ({attrs['status_meaning'].replace('_', ' ')})"
    return (f"{attrs['motion_class']}, {attrs['impacts_per_cycle']:.4g} "
            f"{arrivals_in(attrs).word}s per cycle, deepest separation "
            f"{1e6 * attrs['deepest_separation']:.4g} µrad")


def _sweep(sweep):
    """Points that have a result, and why others have none."""
    status = sweep["status"].values
    done, open_ = (int((status == one).sum()) for one in (Status.OK, Status.UNFINISHED))
    failed = status.size - done - open_
    return (f"{done} of {status.size} points" + f", {open_} not reached" * bool(open_)
            + f", {failed} failed" * bool(failed))
