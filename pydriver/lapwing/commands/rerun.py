"""One run of results once more, with everything about it kept, to see why it fails."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lapwing.base import exit_codes
from lapwing.base.codes import EventKind, Status
from lapwing.base.exit_codes import ExitCode
from lapwing.commands.status import base_of
from lapwing.console import complain
from lapwing.folder import deck_of

if TYPE_CHECKING:
    from lapwing.deck.deck import Deck
    from lapwing.studies.again import Again
    from lapwing.studies.trajectory import Run


def rerun(results: Annotated[Path, typer.Argument(
              metavar="RESULTS", help="folder of results, results/DECK")],
          study: Annotated[str, typer.Argument(
              metavar="STUDY", help="group of the result file: map_NAME, sweep_NAME, "
              "ensemble_NAME, response_NAME")],
          index: Annotated[int, typer.Argument(
              metavar="INDEX", min=0, help="the run, counted as `status` of that group is, "
              "from 0")] = 0,
          out: Annotated[Path | None, typer.Option(
              metavar="DIR", help="write events.csv and cycles.csv there")] = None,
          last: Annotated[int, typer.Option(min=0, help="events to print, the last ones")] = 10,
          as_json: Annotated[bool, typer.Option("--json", help="as JSON")] = False) -> None:
    """Repeat one run of results, from its start: where and how it ends, and its last events.

    \b
    Examples:
      lapwing rerun results/my_map map_plane 4711
      lapwing rerun results/my_pair sweep_torque 12 --out why
    """  # noqa: D301
    from lapwing.deck import DeckError
    from lapwing.results.store import StoreError

    base = base_of(results)
    try:
        deck = deck_of(base)
        again = run_again(deck, study, index)
    except (DeckError, StoreError, ValueError) as error:
        complain(str(error))
        raise typer.Exit(ExitCode.BAD_INPUT) from None
    facts = facts_of(again.run, last)
    facts = {"results": str(base), "study": study, "index": index, "place": again.place, **facts}
    if out is not None:
        try:
            _write(again.run, out)
        except OSError as error:
            complain(exit_codes.words(error, out))
            raise typer.Exit(exit_codes.of_error(error)) from None
    print(json.dumps(facts, indent=1) if as_json else "\n".join(_lines(facts)))
    code = ExitCode.GOOD if again.run.status == Status.OK else ExitCode.FAILED
    raise typer.Exit(code)


def run_again(deck: Deck, group: str, index: int) -> Again:
    """Repeat one run of a study of a deck.

    Raises
    ------
    ValueError
        where there is no such study or run.
    """
    from lapwing.base.registry import STUDIES

    known = {f"{kind}_{asked.name}": (kind, asked) for kind, studies in deck.studies.items()
             for asked in studies if hasattr(STUDIES[kind].part("study"), "again")}
    if group not in known:
        raise ValueError(f"{group}: no study of {deck.path} whose runs are repeated; expected "
                         + (", ".join(known) or "a map, a sweep or a response, of which it has "
                            "none"))
    kind, asked = known[group]
    part = STUDIES[kind].part("study")
    runs, _ = part.extent(asked)
    if index >= runs:
        raise ValueError(f"{group}: run {index}, expected 0 to {runs - 1}")
    again: Again = part.again(deck, asked, index)
    return again


def facts_of(run: Run, last: int) -> dict[str, Any]:
    """How a run ended: time, phase, state and the last events."""
    final, osc = run.final, run.oscillator
    table = run.events.isel(event=slice(max(0, run.events.sizes["event"] - last), None))
    events = [{"tau": float(one["tau"]), "cycle": int(one["cycle"]), "phase": float(one["phase"]),
               "kind": EventKind(int(one["kind"])).name, "phi": float(one["phi"]),
               "velocity_before": float(one["velocity_before"]),
               "velocity_after": float(one["velocity_after"])}
              for i in range(table.sizes["event"]) for one in [table.isel(event=i)]]
    frequency = osc.scales and osc.scales.natural_frequency
    return {"status": run.status.name, "tau": final.tau,
            "time_s": final.tau / frequency if frequency else None,
            "cycles": final.tau / osc.period, "phase": final.phase,
            "motion_state": final.motion_state.name, "phi": final.phi, "phi_dot": final.phi_dot,
            "events": run.events.sizes["event"], "method": run.method, "last_events": events}


def _write(run: Run, out: Path) -> None:
    """Every event and every cycle as tables."""
    from lapwing.base.registry import give_accessor

    give_accessor()
    out.mkdir(parents=True, exist_ok=True)
    for name in ("events", "cycles"):
        getattr(run, name).lapwing.to_csv(out / f"{name}.csv")


def _lines(facts: dict[str, Any]) -> list[str]:
    where = ", ".join(f"{name} = {value}" if isinstance(value, str) else f"{name} = {value!r}"
                      for name, value in facts["place"].items())
    time = "" if facts["time_s"] is None else f" ({facts['time_s']:.6g} s)"
    lines = [f"{facts['results']}: {facts['study']}, run {facts['index']}"
             + f": {where}" * bool(where),
             f"  {facts['status']} at tau = {facts['tau']:.10g}{time}, after "
             f"{facts['cycles']:.6g} mesh cycles, at mesh phase {facts['phase']:.6g}",
             f"  {facts['motion_state'].lower()}: phi = {facts['phi']:.10g} rad, phi' = "
             f"{facts['phi_dot']:.10g} rad per tau; method {facts['method']}",
             f"  {facts['events']} events" + ", the last:" * bool(facts["last_events"])]
    for one in facts["last_events"]:
        lines.append(f"    tau {one['tau']:.10g}  cycle {one['cycle']}  phase {one['phase']:.6f}  "
                     f"{one['kind'].lower()}  velocity {one['velocity_before']:.6g} -> "
                     f"{one['velocity_after']:.6g}")
    return lines
