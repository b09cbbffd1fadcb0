"""A deck carried out: its studies run, its results written, drawn and summarised."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lapwing import __version__
from lapwing.codes import Status
from lapwing.deck import DeckError, changed_keys, load_deck, used_hash, used_text
from lapwing.deck.used import stored_hash

RESULT_FILE = "result.nc"
USED_DECK = "used.nml"
SUMMARY = "summary.md"


class FolderError(Exception):
    """Results of another deck lie where this one's would go."""


@dataclass
class Outcome:
    """How a deck went.

    Attributes
    ----------
    folder : Path, where its results lie
    reused : bool, whether results of the same values were there already
    interrupted : bool, whether the user stopped it; what was finished is kept
    failed : tuple of str, studies in which some run failed numerically
    headlines : tuple of str, the main result of each study
    """

    folder: Path
    reused: bool = False
    interrupted: bool = False
    failed: tuple = ()
    headlines: tuple = ()


def run_deck(deck, parent, *, threads, force=False, progress=None):
    """Run a deck into `parent`/<deck>.

    1. Results of the same values are used again; others are refused unless `force`.
    2. Responses, then sweeps; an interruption keeps the studies that are finished, and the
       points of a sweep that are.
    3. Result file, figures and summary, then `used.nml`, whose presence says that all is there.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    parent : Path, created where missing
    threads : int
    force : bool, whether other results are replaced
    progress : object with `study(label, total, unit)` giving a callable(fraction), or None

    Returns
    -------
    Outcome

    Raises
    ------
    FolderError
        where results of other values lie there and `force` is not given.
    """
    folder = Path(parent) / deck.stem
    if _reusable(deck, folder, force):
        return Outcome(folder, reused=True)
    _clear(folder)
    report = progress.study if progress else (lambda *_: (lambda _: None))
    responses, sweeps, interrupted = _studies(deck, threads, report)
    _write(deck, folder, responses, sweeps)
    _draw(folder, report)
    if not interrupted:
        (folder / USED_DECK).write_text(used_text(deck, folder), encoding="utf-8")
    return Outcome(folder, interrupted=interrupted, failed=_failed(responses, sweeps),
                   headlines=_headlines(responses, sweeps))


def _reusable(deck, folder, force):
    """Whether the folder holds this deck's results; refuses those of another."""
    used = folder / USED_DECK
    if force or not used.exists():
        return False
    text = _read(used)
    same_version = f"! lapwing {__version__}\n" in text
    same_values = stored_hash(text) == used_hash(deck)
    if same_values and same_version and (folder / RESULT_FILE).exists():
        return True
    try:
        changes = changed_keys(load_deck(used), deck) or ("the transmission error's numbers",)
    except DeckError:
        changes = (f"{used} cannot be read",)
    if same_values:
        changes = ("the version of Lapwing",)
    raise FolderError(f"{folder}: results of other values lie there; --force replaces them. "
                      "What differs:\n" + "\n".join(f"  {line}" for line in changes))


def _clear(folder):
    """An empty folder; what an earlier run left goes, file by file, and nothing else."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in (USED_DECK, SUMMARY, RESULT_FILE):
        (folder / name).unlink(missing_ok=True)
    for pattern in ("*.png", "*.pdf"):
        for path in folder.glob(pattern):
            path.unlink()


def _studies(deck, threads, report):
    """Responses and sweeps, as far as the user lets them."""
    responses, sweeps = [], {}
    try:
        for order, response in enumerate(deck.responses):
            done = report(f"response {response.name}", 1, "response")
            responses.append(_response(deck, response, order))
            done(1.0)
        for sweep in deck.sweeps:
            points = len(sweep.values) * len(sweep.starts)
            done = report(f"sweep {sweep.name}", points, "points")
            sweeps[sweep.name] = _sweep(deck, sweep, threads, done)
            if sweeps[sweep.name].attrs["interrupted"]:
                return responses, sweeps, True
    except KeyboardInterrupt:
        return responses, sweeps, True
    return responses, sweeps, False


def _response(deck, study, order):
    from lapwing.studies.response import response

    return response(
        deck.oscillator(study), deck.gear_pair, name=study.name, start=study.start,
        phase=deck.numerics["start_phase"], settle_cycles=study.settle_cycles,
        record_cycles=study.record_cycles, samples_per_cycle=study.samples_per_cycle,
        exponents=study.exponents,
        max_period=deck.numerics["max_period"], order=order,
        brake_torque=study.operation["brake_torque"],
        claim_impacts_per_cycle=study.claim_impacts_per_cycle,
        claim_deepest_separation=study.claim_deepest_separation, claim_text=study.claim_text,
        **deck.numerics_of(study))


def _sweep(deck, study, threads, done):
    from lapwing.studies.sweep import sweep

    observe = ("cycles", *["impacts"] * study.impacts, *["exponents"] * study.exponents,
               *["speeds"] * study.speed_density, *["spectra"] * study.order_spectra)
    return sweep(
        deck.gear_pair, deck.te, parameter=study.parameter, values=study.values,
        starts=study.starts, settle=study.settle_cycles, record=study.record_cycles,
        observe=observe, phase=deck.numerics["start_phase"], threads=threads, progress=done,
        keep_interrupted=True, **deck.numerics_of(study), **study.operation)


def _write(deck, folder, responses, sweeps):
    from lapwing.results import write_results

    write_results(
        folder / RESULT_FILE, deck_name=deck.stem, deck_text=deck.text,
        used_text=used_text(deck, folder), used_hash=used_hash(deck), pair=deck.gear_pair,
        te=deck.te, osc=_reference_oscillator(deck), responses=responses, sweeps=sweeps,
        te_source=_te_source(deck))


def _te_source(deck):
    """Name of the table's file, or None where a formula makes it."""
    name = deck.settings["transmission_error"].file
    return Path(name).name if name else None


def _reference_oscillator(deck):
    """The deck's operating point; what it leaves to its studies is taken from the first."""
    operation = dict(deck.operation)
    if deck.responses:
        operation = {**deck.responses[0].operation, **operation}
    elif deck.sweeps and deck.sweeps[0].group == "operation":
        first = deck.sweeps[0]
        operation = {**operation, **first.operation, first.parameter: float(first.values[0])}
    operation.setdefault("brake_torque", 1.0)
    return deck.gear_pair.oscillator(deck.te, **operation)


def _draw(folder, report):
    """Figures and summary from the file alone."""
    from lapwing.plots import draw_all
    from lapwing.results import read_results
    from lapwing.summary import summary_text

    done = report("figures", 100, "%")
    with read_results(folder / RESULT_FILE) as results:
        draw_all(results, folder, progress=done)
        summary = summary_text(results)
    (folder / SUMMARY).write_text(summary, encoding="utf-8")


def _failed(responses, sweeps):
    """Names of the studies with a run that failed numerically."""
    failed = [f"response {response.attrs['name']}" for response in responses
              if int(response.attrs["status"]) != Status.OK]
    for name, sweep in sweeps.items():
        points = int(((sweep["status"] != Status.OK)
                      & (sweep["status"] != Status.UNFINISHED)).sum())
        if points:
            failed.append(f"sweep {name} ({points} points)")
    return tuple(failed)


def _headlines(responses, sweeps):
    """One line for each study."""
    lines = []
    for response in responses:
        attrs = response.attrs
        lines.append(f"{attrs['name']}: {attrs['motion_class']}, "
                     f"{attrs['impacts_per_cycle']:.4g} impacts per cycle, deepest separation "
                     f"{1e6 * attrs['deepest_separation']:.4g} µrad")
    for name, sweep in sweeps.items():
        done = int((sweep["status"] == Status.OK).sum())
        lines.append(f"{name}: {done} of {sweep['status'].size} points")
    return tuple(lines)


def _read(path):
    return path.read_text(encoding="utf-8") if path.exists() else ""


def plot_file(path, folder=None):
    """Draw every figure of a result file, into its own folder unless another is named.

    Returns
    -------
    list of Path
    """
    from lapwing.plots import draw_all
    from lapwing.results import read_results

    path = Path(path)
    folder = Path(folder) if folder else path.parent
    folder.mkdir(parents=True, exist_ok=True)
    with read_results(path) as results:
        return draw_all(results, folder)


