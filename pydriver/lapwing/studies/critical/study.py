"""Critical values as a deck asks for them."""

from __future__ import annotations

from lapwing.engine import Numerics
from lapwing.studies.critical import measured
from lapwing.studies.critical import run as search
from lapwing.studies.labels import labels


def extent(_):
    """How much of it there is to tell progress by, and in what unit."""
    return 100, "%"


def failed(dataset):
    """What failed numerically, in words; empty text, nothing."""
    runs = int(dataset["trial_failed"].sum()) if "trial_failed" in dataset else 0
    return f"critical {{}} ({runs} motions)" * bool(runs)


def carry_out(deck, study, order, threads, done):
    """One critical value of a deck, told as done at its end; see `registry`."""
    found = critical_study(deck, study, threads, done)
    done(1.0)
    return found


def critical_study(deck, study, threads, done=None):
    """One critical value of a deck.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    study : lapwing.deck.Asked
    threads : int
    done : callable(fraction) or None

    Returns
    -------
    xarray.Dataset, from `lapwing.critical_full` and the like, with `labels.labels`, and of a
    measured transmission error what its noise leaves (`measured`)
    """
    options = {"parameter": study.parameter, "values": study.values, "safe_end": study.safe_end,
               **study.operation}
    if study.starts is not None:
        options |= {"starts": search.StartGrid(*study.starts), "settle": study.settle_cycles,
                    "record": study.record_cycles, "phase": deck.numerics["start_phase"],
                    "numerics": Numerics(**deck.numerics_of(study)), "threads": threads,
                    "progress": done and measured.first_of(deck, study, done)}
    if study.find == "safe":
        options |= {"resolution": study.resolution, "further": study.further_values}
    elif study.find == "back":
        options["confidence"] = study.confidence
    find = {"full": search.critical_full, "safe": search.critical_safe,
            "back": search.critical_back, "on": search.critical_on}[study.find]
    found = find(deck.gear_pair, deck.te, **options).assign_attrs(labels(deck, study))
    if study.find in ("full", "on"):
        return measured.with_interval(found, deck, study)
    if study.find == "safe":
        return measured.with_repeats(found, deck, study, lambda te, told: find(
            deck.gear_pair, te, **{**options, "progress": told}), done)
    return found


def full_engagement(deck, study):
    """T_full where a response, or a sweep of the braking torque, runs.

    The driving torque is in balance or as given.

    Returns
    -------
    dict of the attributes full_engagement (N·m) and full_engagement_phase (mesh periods), and of a
    measured transmission error full_engagement_low and _high, its 95 % interval; empty where there
    is none
    """
    if getattr(study, "parameter", "brake_torque") != "brake_torque" \
            or study.operation["contact_law"] == "rigid":
        return {}
    operation = {key: value for key, value in study.operation.items() if key != "brake_torque"}
    found = search.critical_full(deck.gear_pair, deck.te, **operation).attrs
    if found["outcome"] != "found":
        return {}
    known = {"full_engagement": found["estimate"], "full_engagement_phase": found["phase"]}
    if deck.curve is None:
        return known
    low, high = measured.interval(deck, "full", "brake_torque", operation)
    return known | {"full_engagement_low": low, "full_engagement_high": high}
