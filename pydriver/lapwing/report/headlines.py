"""The main result of each study in one line."""

from __future__ import annotations

from lapwing.base.arrivals import arrivals_in
from lapwing.base.codes import Status
from lapwing.report.critical import headline
from lapwing.report.numbers import doubtful
from lapwing.report.words import parameter_words, plural


def headlines(responses, criticals, sweeps, missing=()):
    """One line for each study.

    Parameters
    ----------
    responses : sequence of Dataset
    criticals, sweeps : dict of name -> Dataset
    missing : sequence of (kind, name), studies of the deck without a result

    Returns
    -------
    tuple of str
    """
    return (*(f"{one.attrs['name']}: {_response(one.attrs)}" for one in responses),
            *(f"{name}: {headline(critical)}" for name, critical in criticals.items()),
            *(f"{name}: {_sweep(sweep)}" for name, sweep in sweeps.items()),
            *(f"{name}: not finished, no result" for _, name in missing))


def _response(attrs):
    if attrs["status"]:
        return f"failed ({attrs['status_meaning'].replace('_', ' ')})"
    if attrs["fully_engaged"]:
        return "engaged throughout"
    period = attrs["period"]
    motion = f"repeats every {'mesh cycle' if period == 1 else f'{period} mesh cycles'}" \
        if period else f"no period up to {plural(attrs['max_period'], 'mesh cycle')}"
    number = float(f"{attrs['impacts_per_cycle']:.4g}")
    return (f"{motion}, {plural(number, arrivals_in(attrs).word)} per cycle, deepest separation "
            f"{'seen ' * (not period)}{1e6 * attrs['deepest_separation']:.4g} µrad"
            + "; the second run gives another motion" * doubtful(attrs))


def _sweep(sweep):
    """Points that have a result, and why others have none."""
    status = sweep["status"].values
    done, open_ = (int((status == one).sum()) for one in (Status.OK, Status.UNFINISHED))
    failed = status.size - done - open_
    along = parameter_words(sweep["status"].dims[1])
    return (f"{done} of {status.size} points have a result, along the {along}"
            + f"; {open_} not reached" * bool(open_) + f"; {failed} failed" * bool(failed))
