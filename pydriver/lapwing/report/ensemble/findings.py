"""What ensembles answer: which torque keeps so many pairs together, how sure, and what matters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lapwing.base.arrivals import arrivals_in
from lapwing.base.messages import percent
from lapwing.report.answers.conditions import Conditions
from lapwing.report.ensemble.text import SAMPLINGS, limits, rank_words
from lapwing.report.words import parameter_unit, parameter_words
from lapwing.results.findings import endings, parameters_of

if TYPE_CHECKING:
    import xarray as xr

# The part of all pairs that is asked about.
LEVEL = 0.99


def findings(ensembles: list[xr.Dataset]) -> list[str]:
    """The answers as sentences in Markdown; none of an ensemble without a result.

    Of ensembles of the same draws what the draws alone decide is said once.
    """
    known = sorted((one for one in ensembles if (one["known"].values > 0).any()),
                   key=lambda one: float(one.attrs.get("brake_torque", math.inf)))
    families = _alike(known)
    said = [_choice(alike) for alike in families]
    said += [_kept(one) for one in known]
    said += [_seen(one) for one in known]
    for alike in families:
        said.append(next(filter(None, map(_effects, alike)), _ranks(alike[0])))
    return list(dict.fromkeys(filter(None, said)))


def _alike(ensembles: list[xr.Dataset]) -> list[list[xr.Dataset]]:
    """Ensembles of the same draws together."""
    found: dict[tuple[bytes, ...], list[xr.Dataset]] = {}
    for one in ensembles:
        drawn = tuple(one[name].values.tobytes() for name in parameters_of(one))
        found.setdefault(drawn, []).append(one)
    return list(found.values())


def _draws(data: xr.Dataset) -> str:
    return f"{data['status'].size} {SAMPLINGS[data.attrs['sampling']]}"


def _kept(data: xr.Dataset) -> str:
    """The torque above which 99 % of all pairs can keep contact."""
    if "full_engagement_quantile" not in data:
        return ""
    one = data.sel(level=LEVEL)
    value, low, high = (float(one[f"full_engagement_quantile{end}"])
                        for end in ("", "_low", "_high"))
    if not math.isfinite(value):
        return ""
    unit = parameter_unit("brake_torque")
    lost = int((~np.isfinite(data["full_engagement"].values)).sum())
    of = f"{_draws(data)}, T_full of each in closed form" \
        + f"; {lost} of them have none, which the limits allow for" * bool(lost)
    if int(data.attrs["scrambles"]) < 0:
        return (f"**{100 * LEVEL:g} % of the pairs listed can keep contact from {value:.4g} "
                f"{unit}** ({of}).")
    ends = limits(low, high, lambda end: f"{end:.4g}")
    sure = f"95 % limits {ends} {unit}" if math.isfinite(low) and math.isfinite(high) else \
        f"95 % limits {ends}: more draws would say" if ends else "its limits are not known"
    return (f"**{100 * LEVEL:g} % of pairs can keep contact from {value:.4g} {unit}** ({sure}; "
            f"{of}): can, for rattling may live beside it.")


def _seen(data: xr.Dataset) -> str:
    """What the runs of an ensemble saw."""
    attrs, (done, open_, failed) = data.attrs, endings(data)
    if not done:
        return ""
    at = f"At {float(attrs['brake_torque']):g} {parameter_unit('brake_torque')}" \
        if "brake_torque" in attrs else "Over all pairs drawn"
    rattles, back = (data.sel(event=name) for name in ("rattles", "back_arrivals"))
    stay = [1 - float(rattles[f"probability{end}"]) for end in ("", "_high", "_low")]
    parts = [f"**{at} {percent(stay[0])} of pairs stay together**{_limits(stay[1], stay[2])}, each "
             f"from rest: rattling in {int(rattles['seen'])} of {int(rattles['known'])} "
             f"(ensemble `{attrs['name']}`)"]
    word = arrivals_in(attrs).word
    seen, chance = int(back["seen"]), percent(float(back["probability"]))
    ends = _limits(float(back["probability_low"]), float(back["probability_high"]))
    parts.append(f"back {word}s in {chance}{ends}" if seen else f"no back {word}s{ends}")
    lost = f" {failed} runs failed" * bool(failed) + " and" * bool(failed and open_) \
        + f" {open_} were not reached" * bool(open_)
    return "; ".join(parts) + "." + (lost + ": what is likely is of the others, the limits allow "
                                     "for anything.") * bool(lost)


def _limits(low: float, high: float) -> str:
    ends = limits(low, high, percent)
    return f" (95 % limits {ends})" if ends else ""


def _choice(ensembles: list[xr.Dataset]) -> str:
    """The least of the torques that were run at which surely so many pairs stay together."""
    tried = [one for one in ensembles if "brake_torque" in one.attrs
             and int(one.attrs["scrambles"]) >= 0]
    if not tried:
        return ""
    unit, part = parameter_unit("brake_torque"), f"{100 * LEVEL:g} %"
    stay = {float(one.attrs["brake_torque"]):
            1 - float(one.sel(event="rattles")["probability_high"]) for one in tried}
    sure = [torque for torque in stay if all(
        stay[other] >= LEVEL for other in stay if other >= torque)]
    if not sure:
        return (f"**No torque that was run surely keeps {part} of pairs together**: look at "
                f"higher ones than {max(stay):g} {unit}, or at more pairs.")
    least, below = min(sure), [torque for torque in stay if torque < min(sure)]
    chance = percent(stay[least])
    next_ = f" At {max(below):g} {unit}, the next below, {part} are not sure." if below else \
        " Lower torques were not run."
    return (f"**Choose {least:g} {unit} on the gear**{_conditions(tried[0])}: there at least "
            f"{chance} of pairs keep contact (95 % confidence).{next_} A start other than from "
            "rest, a longer look or other tolerances may move it. "
            + _tolerances(tried[0])).rstrip()


def _conditions(data: xr.Dataset) -> str:
    """Speed and impact law, as far as they are the same for all pairs."""
    words = Conditions.of(data.attrs, float(data.attrs.get("pinion_teeth", math.nan))).words(
        data.attrs)
    return f" ({words})" if words else ""


def _tolerances(data: xr.Dataset) -> str:
    """What was drawn, and how far it spreads."""
    told = []
    for name in parameters_of(data):
        values, unit = data[name].values, parameter_unit(name)
        factor, unit = (1e6, "µrad") if unit == "rad" else (1.0, unit)
        middle, spread = (float(f"{factor * of(values):.{digits}g}")
                          for of, digits in ((np.mean, 3), (np.std, 2)))
        told.append(f"{parameter_words(name)} {middle:g} ± {spread:g} {unit}".rstrip())
    return f"Drawn were (mean ± standard deviation) {', '.join(told)}." if told else ""


def _answer(data: xr.Dataset) -> tuple[str, str]:
    """Name and words of what is asked first: T_full where it is known."""
    return ("full_engagement", "T_full") if "full_engagement" in data \
        else ("deepest_separation", "the deepest separation")


def _effects(data: xr.Dataset) -> str:
    """Which parameter matters most, by Sobol's sensitivities; empty text where there are none."""
    names, (answer, words) = parameters_of(data), _answer(data)
    if len(names) < 2 or "total_effect" not in data:
        return ""
    total, low, high = (data[f"total_effect{end}"].sel(answer=answer).values
                        for end in ("", "_low", "_high"))
    if not np.isfinite(total).all():
        return ""
    order = np.argsort(-total, kind="stable")
    first, second = order[:2]
    told = [f"{parameter_words(names[i])}{' has' * bool(i == first)} a part in "
            f"{100 * total[i]:.0f} % ({100 * low[i]:.0f} to {100 * high[i]:.0f} %)"
            for i in order[:3]]
    if low[first] <= high[second]:
        return (f"**What matters most for {words} is not sure**: of its variance, with 95 % limits "
                f"that overlap, {'; '.join(told)}.")
    return (f"**What matters most for {words} is the {parameter_words(names[first])}**: of its "
            f"variance, with 95 % limits, {'; '.join(told)}.")


def _ranks(data: xr.Dataset) -> str:
    """Which parameter goes most with the answer, by rank correlations."""
    names, (answer, words) = parameters_of(data), _answer(data)
    of_answer = data.sel(answer=answer)
    ranks = of_answer["rank_correlation"].values
    if len(names) < 2 or not np.isfinite(ranks).any():
        return ""
    order = np.argsort(-np.abs(np.nan_to_num(ranks)), kind="stable")
    told = ", ".join(f"{parameter_words(names[i])} {rank_words(of_answer.isel(parameter=i))}"
                     for i in order[:3])
    return (f"**What goes most with {words} is the {parameter_words(names[order[0]])}**, of the "
            f"runs made: rank correlations, with 95 % limits where they are known, {told}.")
