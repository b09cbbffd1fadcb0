"""A deck carried out: its studies run, its results written, drawn and summarised."""

from __future__ import annotations

import ctypes
import threading
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue

from lapwing import __version__
from lapwing.codes import Status
from lapwing.deck import DeckError, changed_keys, load_deck, used_hash, used_text
from lapwing.deck.schema import SPEEDS
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
    undrawn : dict of name -> str, figures that could not be drawn, and why
    headlines : tuple of str, the main result of each study
    """

    folder: Path
    reused: bool = False
    interrupted: bool = False
    failed: tuple = ()
    undrawn: dict = field(default_factory=dict)
    headlines: tuple = ()


def run_deck(deck, parent, *, threads, force=False, progress=None):
    """Run a deck into `parent`/<deck>.

    1. Results of the same values are used again; others are refused unless `force`.
    2. Responses, side by side, critical values, sweeps; an interruption keeps the studies that are
       finished, and the points of a sweep that are.
    3. Result file, summary and figures, then `used.nml`, whose presence says that all is there.

    Parameters
    ----------
    deck : lapwing.deck.Deck
    parent : Path, created where missing
    threads : int; threads that compute, and processes that draw; no result depends on it
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
    from lapwing.plots.crew import Crew
    from lapwing.report.headlines import headlines

    folder = Path(parent) / deck.stem
    if _reusable(deck, folder, force):
        return Outcome(folder, reused=True)
    _clear(folder)
    report = progress.study if progress else (lambda *_: (lambda _: None))
    with Crew(threads) as crew:
        responses, criticals, sweeps, interrupted = _studies(deck, threads, report)
        _write(deck, folder, responses, criticals, sweeps)
        undrawn = _present(folder, crew, report)
    if not interrupted and not undrawn:
        (folder / USED_DECK).write_text(used_text(deck, folder), encoding="utf-8")
    return Outcome(folder, interrupted=interrupted, failed=_failed(responses, criticals, sweeps),
                   undrawn=undrawn, headlines=headlines(responses, criticals, sweeps))


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
    """Responses, critical values and sweeps, as far as the user lets them."""
    from lapwing.studies.critical_of_deck import critical_study

    responses, criticals, sweeps = [], {}, {}
    try:
        if deck.responses:
            done = report("responses", len(deck.responses), "responses")
            if not _responses(deck, threads, responses, done):
                return responses, criticals, sweeps, True
        for critical in deck.criticals:
            done = report(f"critical {critical.name}", 100, "%")
            criticals[critical.name] = critical_study(deck, critical, threads, done)
            done(1.0)
        for sweep in deck.sweeps:
            points = len(sweep.values) * len(sweep.starts)
            done = report(f"sweep {sweep.name}", points, "points")
            sweeps[sweep.name] = _sweep(deck, sweep, threads, done)
            if sweeps[sweep.name].attrs["interrupted"]:
                return responses, criticals, sweeps, True
    except KeyboardInterrupt:
        return responses, criticals, sweeps, True
    return responses, criticals, sweeps, False


def _responses(deck, threads, responses, done):
    """Add the responses of a deck, in its order; returns whether all are there."""
    import lapwing.studies.response  # noqa: F401 - by one thread, before there are several

    studies = list(enumerate(deck.responses))
    found, complete = side_by_side(lambda one: _response(deck, one[1], one[0]), studies,
                                   threads, done)
    responses += [found[order] for order in sorted(found)]
    return complete


def side_by_side(function, items, threads, done):
    """Call a function of each item, several at a time.

    The engine works without Python's lock and keeps nothing between calls, so that threads do.

    Parameters
    ----------
    function : callable(item)
    items : sequence
    threads : int
    done : callable(fraction done)

    Returns
    -------
    results : dict of place in `items` -> what the function returned
    complete : bool, False after Ctrl-C, which keeps what is finished

    Raises
    ------
    Exception
        the first that a call raised; the others are given up.
    """
    waiting, results, errors = SimpleQueue(), {}, []
    stop, lock = threading.Event(), threading.Lock()
    for place in range(len(items)):
        waiting.put(place)

    def work():
        while not stop.is_set():
            try:
                place = waiting.get_nowait()
            except Empty:
                return
            result = function(items[place])
            with lock:
                results[place] = result
                done(len(results) / len(items))

    def help_out():
        try:
            work()
        except KeyboardInterrupt:
            pass  # handed on
        except Exception as error:
            errors.append(error)
            stop.set()

    helpers = [threading.Thread(target=help_out) for _ in range(min(threads, len(items)) - 1)]
    try:
        for helper in helpers:
            helper.start()
        work()
        for helper in helpers:
            helper.join()
    except BaseException as error:
        stop.set()
        for helper in helpers:
            _interrupt(helper)
        if not isinstance(error, KeyboardInterrupt):
            raise
        return results, False
    if errors:
        raise errors[0]
    return results, True


def _interrupt(thread):
    """Hand Ctrl-C, which only the main thread hears, on to another, and wait for its end."""
    if thread.is_alive():
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident),
                                                   ctypes.py_object(KeyboardInterrupt))
        thread.join()


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
    from lapwing.studies.critical_of_deck import full_engagement
    from lapwing.studies.sweep import sweep

    observe = ("cycles", *["impacts"] * study.impacts, *["exponents"] * study.exponents,
               *["speeds"] * study.speed_density, *["spectra"] * study.order_spectra)
    result = sweep(
        deck.gear_pair, deck.te, parameter=study.parameter, values=study.values,
        starts=study.starts, settle=study.settle_cycles, record=study.record_cycles,
        observe=observe, phase=deck.numerics["start_phase"], threads=threads, progress=done,
        keep_interrupted=True, **deck.numerics_of(study), **study.operation)
    result = result.assign_attrs(full_engagement(deck, study))
    if not study.impacts:
        return result
    # Most of the room for impacts is empty, and is slow to be compressed.
    return result.isel(impact=slice(0, max(1, int(result["n_impacts"].max()))))


def _write(deck, folder, responses, criticals, sweeps):
    from lapwing.results import write_results

    write_results(
        folder / RESULT_FILE, deck_name=deck.stem, deck_text=deck.text,
        used_text=used_text(deck, folder), used_hash=used_hash(deck), pair=deck.gear_pair,
        te=deck.te, osc=_reference_oscillator(deck), responses=responses, sweeps=sweeps,
        criticals=criticals, te_source=_te_source(deck))


def _te_source(deck):
    """Name of the table's file, or None where a formula makes it."""
    name = deck.settings["transmission_error"].file
    return Path(name).name if name else None


def _reference_oscillator(deck):
    """The deck's operating point; what it leaves to its studies is taken from the first."""
    operation = dict(deck.operation)
    if not operation.keys() & set(SPEEDS):
        first = (*deck.responses, *deck.sweeps, *deck.criticals)[0]
        operation |= first.operation
        if getattr(first, "group", None) == "operation":
            operation[first.parameter] = 1.0 if first.values is None else float(first.values[0])
    operation.setdefault("brake_torque", 1.0)
    return deck.gear_pair.oscillator(deck.te, **operation)


def _present(folder, crew, report):
    """Summary and figures from the file alone; returns figures not drawn, and why."""
    from lapwing.plots import FigureError, draw_all
    from lapwing.report.summary import summary_text
    from lapwing.results import read_results

    done = report("figures", 100, "%")
    with read_results(folder / RESULT_FILE) as results:
        (folder / SUMMARY).write_text(summary_text(results), encoding="utf-8")
        try:
            draw_all(results, folder, progress=done, crew=crew)
        except FigureError as error:
            return error.failures
    return {}


def _failed(responses, criticals, sweeps):
    """Names of the studies with a run that failed numerically."""
    failed = [f"response {response.attrs['name']}" for response in responses
              if int(response.attrs["status"]) != Status.OK]
    for name, critical in criticals.items():
        runs = int(critical["trial_failed"].sum()) if "trial_failed" in critical else 0
        if runs:
            failed.append(f"critical {name} ({runs} motions)")
    for name, sweep in sweeps.items():
        points = int(((sweep["status"] != Status.OK)
                      & (sweep["status"] != Status.UNFINISHED)).sum())
        if points:
            failed.append(f"sweep {name} ({points} points)")
    return tuple(failed)


def _read(path):
    return path.read_text(encoding="utf-8") if path.exists() else ""


def plot_file(path, folder=None, threads=1):
    """Draw every figure of a result file, into its own folder unless another is named.

    Parameters
    ----------
    path : str or Path
    folder : str or Path, or None
    threads : int, processes that draw

    Returns
    -------
    list of Path

    Raises
    ------
    lapwing.plots.FigureError
        where some figures could not be drawn; the others are there.
    """
    from lapwing.plots import draw_all
    from lapwing.plots.crew import Crew
    from lapwing.results import read_results

    path = Path(path)
    folder = Path(folder) if folder else path.parent
    folder.mkdir(parents=True, exist_ok=True)
    with read_results(path) as results, Crew(threads) as crew:
        return draw_all(results, folder, crew=crew)
