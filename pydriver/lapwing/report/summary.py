"""What a run found, in words and tables (Markdown), and in a line for each study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from lapwing.base.registry import carried_out, summarised
from lapwing.report.answers.conditions import Conditions
from lapwing.report.answers.findings import findings, findings_lines
from lapwing.report.measured import curve_sentences

if TYPE_CHECKING:
    import xarray as xr

    from lapwing.results.file import Results


def summary_text(results: Results, figures: Sequence[str] = ()) -> str:
    """The summary of a result file.

    Parameters
    ----------
    results : Results, from `lapwing.results.read_results`
    figures : sequence of str, file names of the figures beside it, the first to look at first

    Returns
    -------
    str
        Markdown: the findings in a few sentences, gear and operation, tables of the critical
        values and of the responses; then what each search and sweep found, a paragraph for each
        response, provenance.
    """
    found = {study: [results.study(study.kind, name) for name in results.studies[study.kind]]
             for study in summarised()}
    lines = [f"# {results.attrs['deck_name']}", "", *_first(figures),
             *findings_lines(findings(
                 *studies_in(results), results.missing,
                 *(_all(results, kind) for kind in ("map", "ensemble", "branches", "basins",
                                                    "attractors")),
                 conditions=Conditions.of(results.operation, float(results.gear_pair.get(
                     "pinion_teeth", math.nan))))), "",
             *_gear(results)]
    for study, datasets in found.items():
        part = study.part("report")
        lines += part.table(datasets) if datasets and hasattr(part, "table") else []
    for study, datasets in found.items():
        lines += study.part("report").section(datasets, results) if datasets else []
    lines += _missing(results)
    return "\n".join([*lines, "", "## Provenance", "", *_provenance(results)]) + "\n"


def _first(figures: Sequence[str]) -> list[str]:
    """Which figure to look at first."""
    if not figures:
        return []
    more = len(figures) - 1
    # No empty line: the findings, with the torque to choose, stand within ten lines.
    return [f"Figure to look at first: [{figures[0]}]({figures[0]})" + f"; {more} more beside it"
            * bool(more) + "."]


def headlines(found: dict[str, dict[str, xr.Dataset]], missing: Any = ()) -> tuple[str, ...]:
    """One line for each study.

    Parameters
    ----------
    found : dict of kind -> dict of name -> Dataset
    missing : sequence of (kind, name), studies of the deck without a result

    Returns
    -------
    tuple of str
    """
    return (*(f"{name}: {study.part('report').headline(dataset)}" for study in carried_out()
              for name, dataset in found.get(study.kind, {}).items()),
            *(f"{name}: not finished, no result" for _, name in missing))


def studies_in(results: Results) -> tuple[list[xr.Dataset], list[xr.Dataset], list[xr.Dataset]]:
    """Datasets of the responses, critical values and sweeps of a result file, in its order."""
    return ([results.response(name) for name in results.responses],
            [results.critical(name) for name in results.criticals],
            [results.sweep(name) for name in results.sweeps])


def _all(results: Results, kind: str) -> list[xr.Dataset]:
    """Datasets of the studies of a kind."""
    return [results.study(kind, name) for name in results.studies[kind]]


def _missing(results: Results) -> list[str]:
    """The studies of the deck that have no result, by name; none where all have."""
    nothing = not any(results.studies.values())
    if not (nothing or results.missing):
        return []
    names = ", ".join(f"{kind} `{name}`" for kind, name in results.missing)
    return ["", "## Not finished", "", " ".join(
        ["The run was stopped before all studies of the deck were finished."] * results.interrupted
        + [f"No result: {names}."] * bool(names) + ["Nothing is known."] * nothing)]


def _gear(results: Results) -> list[str]:
    """What was computed: gear, transmission error, laws."""
    responses = [results.response(name).attrs for name in results.responses]
    pair, table = results.gear_pair, results.transmission_error.attrs
    lines = [
        f"{pair['pinion_teeth']} × {pair['gear_teeth']} teeth, backlash "
        f"{1e6 * pair['backlash']:g} µrad, restitution {pair['restitution']:g}, damping ratio "
        f"{pair['damping_ratio']:g}, natural frequency "
        f"{pair['natural_frequency'] / (2 * math.pi):.6g} Hz. Transmission error: "
        f"{table['source']}, {1e6 * table['peak_to_peak']:.4g} µrad peak to peak, sign "
        f"`{table['te_sign']}`."]
    lines += curve_sentences(table)
    if responses:
        laws = sorted({f"contact law `{one['contact_law']}`, impact law `{one['impact_law']}`, gap "
                       f"`{one['gap']}`, mesh frequency {1 / one['mesh_period_s']:.6g} Hz"
                       for one in responses})
        lines.append("Responses: " + "; ".join(laws) + ".")
    return [" ".join(lines)]


def _provenance(results: Results) -> list[str]:
    attrs = results.attrs
    return [f"Lapwing {attrs['lapwing_version']} ({attrs['compiler']}, {attrs['build_flags']}, "
            f"{attrs['build_type']}) on {attrs['cpu']}; Python {attrs['python_version']}, NumPy "
            f"{attrs['numpy_version']}. Deck `{attrs['deck_name']}`, hash of the values used "
            f"`{attrs['used_hash']}`."]
