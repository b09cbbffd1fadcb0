"""The studies of a deck, one after the other, as far as signals and earlier runs let them."""

from __future__ import annotations

from dataclasses import dataclass, field

from lapwing.base.codes import Status


@dataclass
class Found:
    """What a deck's studies gave.

    Attributes
    ----------
    responses, criticals, sweeps : dict of name -> Dataset, in deck order
    interrupted : bool, whether a signal stopped them: some are missing, or a sweep is unfinished
    """

    responses: dict = field(default_factory=dict)
    criticals: dict = field(default_factory=dict)
    sweeps: dict = field(default_factory=dict)
    interrupted: bool = False

    def failed(self):
        """Names of the studies with a run that failed numerically."""
        failed = [f"response {name}" for name, response in self.responses.items()
                  if int(response.attrs["status"]) != Status.OK]
        for name, critical in self.criticals.items():
            runs = int(critical["trial_failed"].sum()) if "trial_failed" in critical else 0
            if runs:
                failed.append(f"critical {name} ({runs} motions)")
        for name, sweep in self.sweeps.items():
            points = int(((sweep["status"] != Status.OK)
                          & (sweep["status"] != Status.UNFINISHED)).sum())
            if points:
                failed.append(f"sweep {name} ({points} points)")
        return tuple(failed)


def is_finished(study):
    """Whether a stored study lacks nothing: it may be taken over from an earlier run."""
    return not int(study.attrs.get("interrupted", 0))


def studies_of(deck):
    """(kind, name) of every study that a deck asks for, in the order they are carried out."""
    return [(kind, study.name) for kind in ("response", "critical", "sweep")
            for study in getattr(deck, kind + "s")]


def compute(deck, threads, report, known=None):
    """Run the studies of a deck.

    1. Responses, side by side.
    2. Critical values and sweeps, in deck order.
    3. A signal (KeyboardInterrupt) ends it: what is finished is kept, the finished points of the
       sweep under way as well.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    threads : int
    report : callable(label, total, unit) giving a callable(fraction done)
    known : dict of (kind, name) -> Dataset, finished studies of an earlier run; not run again

    Returns
    -------
    Found
    """
    from lapwing.studies.critical.of_deck import critical_study

    known, found = known or {}, Found()
    try:
        if deck.responses and not _responses(deck, threads, report, known, found):
            found.interrupted = True
            return found
        for study in deck.criticals:
            stored = known.get(("critical", study.name))
            if stored is None:
                done = report(f"critical {study.name}", 100, "%")
                stored = critical_study(deck, study, threads, done)
                done(1.0)
            found.criticals[study.name] = stored
        for study in deck.sweeps:
            stored = known.get(("sweep", study.name))
            if stored is None:
                points = len(study.values) * len(study.starts)
                done = report(f"sweep {study.name}", points, "points")
                stored = _sweep(deck, study, threads, done)
            found.sweeps[study.name] = stored
            if not is_finished(stored):
                found.interrupted = True
                return found
    except KeyboardInterrupt:
        found.interrupted = True
    return found


def _responses(deck, threads, report, known, found):
    """Add the responses of a deck, in its order; returns whether all are there."""
    import lapwing.studies.response.run  # noqa: F401 - by one thread, before there are several
    from lapwing.studies.side_by_side import side_by_side

    orders = [order for order, study in enumerate(deck.responses)
              if ("response", study.name) not in known]
    done = report("responses", len(orders), "responses")
    new, complete = side_by_side(lambda order: _response(deck, deck.responses[order], order),
                                 orders, threads, done)
    new = {orders[place]: response for place, response in new.items()}
    for order, study in enumerate(deck.responses):
        response = known.get(("response", study.name), new.get(order))
        if response is not None:
            found.responses[study.name] = response
    return complete


def _response(deck, study, order):
    from lapwing.studies.critical.of_deck import full_engagement
    from lapwing.studies.labels import labels
    from lapwing.studies.response.measured import with_repeats
    from lapwing.studies.response.run import response

    result = response(
        deck.oscillator(study), deck.gear_pair, name=study.name, start=study.start,
        phase=deck.numerics["start_phase"], settle_cycles=study.settle_cycles,
        record_cycles=study.record_cycles, samples_per_cycle=study.samples_per_cycle,
        exponents=study.exponents,
        max_period=deck.numerics["max_period"], order=order,
        brake_torque=study.operation["brake_torque"],
        claim_impacts_per_cycle=study.claim_impacts_per_cycle,
        claim_deepest_separation=study.claim_deepest_separation, claim_text=study.claim_text,
        **deck.numerics_of(study))
    result = result.assign_attrs(labels(deck, study) | full_engagement(deck, study))
    return with_repeats(result, deck, study)


def _sweep(deck, study, threads, done):
    from lapwing.studies.critical.of_deck import full_engagement
    from lapwing.studies.labels import labels
    from lapwing.studies.sweep.run import sweep

    observe = ("cycles", *["impacts"] * study.impacts, *["exponents"] * study.exponents,
               *["speeds"] * study.speed_density, *["spectra"] * study.order_spectra,
               *["amplitudes"] * study.amplitudes)
    result = sweep(
        deck.gear_pair, deck.te, parameter=study.parameter, values=study.values,
        starts=study.starts, settle=study.settle_cycles, record=study.record_cycles,
        observe=observe, phase=deck.numerics["start_phase"], threads=threads, progress=done,
        keep_interrupted=True, **deck.numerics_of(study), **study.operation)
    result = result.assign_attrs(labels(deck, study) | full_engagement(deck, study))
    if not study.impacts:
        return result
    # Most of the room for impacts is empty, and is slow to be compressed.
    return result.isel(impact=slice(0, max(1, int(result["n_impacts"].max()))))
