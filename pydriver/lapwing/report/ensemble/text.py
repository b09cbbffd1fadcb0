"""What an ensemble says in words: how likely, between which limits, and what it depends on."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from lapwing.base.codes import Status
from lapwing.base.messages import percent
from lapwing.report.words import markdown, parameter_words, plural, sections, with_result
from lapwing.results.findings import answers, endings, events_of, influenced, parameters_of

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.results import Results

# Names of ways to draw, in a sentence.
SAMPLINGS = {"sobol": "scrambled Sobol draws", "latin_hypercube": "draws of Latin hypercubes",
             "random": "random draws", "table": "rows of a table"}


def section(ensembles: list[xr.Dataset], results: Results) -> list[str]:
    """The summary's part on ensembles; see `registry`."""
    return sections("Ensemble", ensembles, ensemble_text)


def headline(data: xr.Dataset) -> str:
    """Runs that have a result, and why others have none."""
    return with_result(data, "runs", _drawn(data))


def _drawn(data: xr.Dataset) -> str:
    what = ", ".join(map(parameter_words, parameters_of(data)))
    return f"{SAMPLINGS[data.attrs['sampling']]} of {what}" \
        if data.attrs["sampling"] != "table" else f"rows of a table of {what}"


def ensemble_text(data: xr.Dataset) -> list[str]:
    """Findings of one ensemble, lists and tables.

    Parameters
    ----------
    data : xarray.Dataset, group `ensemble_<name>` of a result file

    Returns
    -------
    list of str, lines of Markdown
    """
    attrs, (_, open_, failed) = data.attrs, endings(data)
    total = data["status"].size
    laws = [f"{parameter_words(name)}: {attrs[f'draw_{name}']}" for name in parameters_of(data)
            if f"draw_{name}" in attrs]
    lines = [
        f"- {total} {SAMPLINGS[attrs['sampling']]}, each pair from rest, contact law "
        f"`{attrs['contact_law']}`, {plural(attrs['settle'], 'mesh cycle')} to settle and "
        f"{attrs['record']} recorded; {failed or 'none'} failed"
        + f", **{open_} not reached**" * bool(open_),
        *["- drawn (units of the deck): " + "; ".join(laws)] * bool(laws),
        *["- correlated, by a Gaussian copula: the matrix is of the normal variables behind "
          "the draws"] * ("correlation" in attrs), f"- {_how_sure(data)}"]
    if not (data["known"].values > 0).any():
        return [*lines, "- no run has a result: nothing is known"]
    return [*lines, "", *_probabilities(data), "", *_quantiles(data), "", *_influences(data)]


def _how_sure(data: xr.Dataset) -> str:
    attrs, scrambles = data.attrs, int(data.attrs["scrambles"])
    lost = " A run without a result may be anything: the limits allow for it." \
        * bool((data["status"].values != Status.OK).any())
    if scrambles < 0:
        return "nobody knows of what all the rows are a sample: nothing is said beyond them"
    if scrambles == 0:
        return f"95 % limits, exact (Clopper and Pearson, order statistics).{lost}"
    return (f"95 % limits, by Student's t of {scrambles} independent scrambles of "
            f"{data['status'].size // scrambles}; where fewer than {2 * scrambles} pairs differ "
            f"from the rest, at least those of as many independent draws (seed {attrs['seed']})."
            f"{lost}")


def limits(low: float, high: float, spell: Any) -> str:
    """`low to high`, an end that is not known in words; empty text where neither is."""
    ends = [spell(one) if math.isfinite(one) else "not known" for one in (low, high)]
    return " to ".join(ends) if any(map(math.isfinite, (low, high))) else ""


def _probabilities(data: xr.Dataset) -> list[str]:
    rows = [("what", "seen in", "probability", "95 % limits")]
    for name, words in events_of(data).items():
        one = data.sel(event=name)
        ends = limits(float(one["probability_low"]), float(one["probability_high"]), percent)
        rows.append((words, f"{int(one['seen'])} of {int(one['known'])}",
                     percent(float(one["probability"])), ends or "–"))
    return markdown(rows)


def _quantiles(data: xr.Dataset) -> list[str]:
    """Each answer's quantiles, their limits behind them."""
    levels = data["level"].values
    rows = [("of pairs", *(f"{100 * level:g} % have at most" for level in levels))]
    for answer in answers(data):
        cells = []
        for level in levels:
            value, low, high = (answer.factor * float(
                data[f"{answer.name}_quantile{end}"].sel(level=level))
                for end in ("", "_low", "_high"))
            ends = limits(low, high, lambda one: f"{one:.4g}")
            cells.append((f"{value:.4g}" if math.isfinite(value) else "not known")
                         + f" ({ends})" * bool(ends) * (low != high))
        rows.append((answer.words + f" ({answer.unit})" * bool(answer.unit), *cells))
    return markdown(rows)


def _influences(data: xr.Dataset) -> list[str]:
    """What each parameter moves."""
    names, moved = parameters_of(data), influenced(data)
    known = [answer for answer in moved
             if np.isfinite(data["rank_correlation"].sel(answer=answer)).any()]
    lines: list[str] = []
    if known:
        rows = [("rank correlation with", *(moved[answer] for answer in known))]
        rows += [(parameter_words(name), *(
            rank_words(data.sel(answer=answer, parameter=name)) for answer in known))
            for name in names]
        lines = markdown(rows)
        if np.isfinite(data.get("rank_correlation_low", math.nan)).any():
            lines += ["", "In brackets 95 % limits, by a jackknife over scrambles or groups of "
                      "draws; none where a run is lost or too few differ."]
    if int(data.attrs["sensitivity_runs"]):
        lines += ["", *_effects(data, names, moved)]
    return lines


def rank_words(one: xr.Dataset) -> str:
    """A rank correlation and its limits, of one answer and one parameter."""
    value, low, high = (float(one.get(f"rank_correlation{end}", math.nan))
                        for end in ("", "_low", "_high"))
    if not math.isfinite(value):
        return "–"
    between = limits(low, high, lambda end: f"{end:+.2f}")
    return f"{value:+.2f}" + f" ({between})" * bool(between)


def _effects(data: xr.Dataset, names: list[str], moved: dict[str, str]) -> list[str]:
    attrs = data.attrs
    told = [answer for answer in moved
            if np.isfinite(data["main_effect"].sel(answer=answer)).all()]
    lost = int(attrs["sensitivity_runs_lost"])
    if not told:
        why = f"{plural(lost, 'run')} of {attrs['sensitivity_runs']} without a result" if lost \
            else "no answer varies in each scramble"
        return [f"Sensitivities are not known: {why}."]
    rows = [("part of the variance", *(f"of {moved[answer]}, {what}" for answer in told
                                       for what in ("alone", "with others")))]
    for name in names:
        one = data.sel(parameter=name)
        rows.append((parameter_words(name), *(
            f"{100 * float(one[f'{what}_effect'].sel(answer=answer)):.0f} % ("
            + " to ".join(f"{100 * float(one[f'{what}_effect_{end}'].sel(answer=answer)):.0f}"
                          for end in ("low", "high")) + ")"
            for answer in told for what in ("main", "total"))))
    others = [words for answer, words in moved.items() if answer not in told]
    return [*markdown(rows), "", f"Sobol's sensitivities, from {attrs['sensitivity_runs']} runs of "
            "their own, 95 % limits by Student's t of the scrambles (estimates: an end may lie "
            "below 0 or above 100 %)" + f". Not told: {', '.join(others)}, which "
            f"{'do' if len(others) > 1 else 'does'} not vary in each scramble or "
            f"{'lack' if len(others) > 1 else 'lacks'} a run" * bool(others) + "."]
