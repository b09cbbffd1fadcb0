"""Carrying out a deck: work side by side, and what remains when it is stopped or fails."""

import _thread
import threading
import time

import pytest

from lapwing.cli import FAILED, OK
from lapwing.run import side_by_side
from test_cli import call, write_deck


def ignore(_):
    pass


@pytest.mark.parametrize("threads", [1, 2, 9])
def test_results_are_told_by_their_place(threads):
    shares = []
    found, complete = side_by_side(lambda x: x * x, range(6), threads, shares.append)
    assert complete and found == {place: place * place for place in range(6)}
    assert shares == [pytest.approx(n / 6) for n in range(1, 7)]


def test_two_are_at_work_at_once():
    """Each waits for the other; one after the other, they would wait for ever."""
    barrier = threading.Barrier(2, timeout=20)
    found, complete = side_by_side(lambda _: barrier.wait(), range(2), 2, ignore)
    assert complete and sorted(found.values()) == [0, 1]


@pytest.mark.parametrize("threads", [1, 2])
def test_an_error_is_raised(threads):
    def work(x):
        if x == 3:
            raise ValueError("three")
        return x

    with pytest.raises(ValueError, match="three"):
        side_by_side(work, range(6), threads, ignore)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interruption_reaches_every_thread_and_keeps_what_is_finished(threads):
    """Item 0 is short, the others go on until they are interrupted."""
    begun = threading.Semaphore(0)

    def work(x):
        if x == 0:
            return x
        begun.release()
        until = time.monotonic() + 60
        while time.monotonic() < until:
            time.sleep(0.01)
        return x

    def interrupt():
        for _ in range(threads):
            begun.acquire()
        _thread.interrupt_main()

    threading.Thread(target=interrupt).start()
    before = time.monotonic()
    found, complete = side_by_side(work, range(6), threads, ignore)
    assert not complete and found == {0: 0}
    assert time.monotonic() - before < 30
    assert threading.active_count() <= 2


def test_a_figure_that_fails_leaves_the_others_and_is_named(tmp_path, monkeypatch):
    """No `used.nml` then: the next run does not take these results for complete."""
    from lapwing.plots import te_curve

    monkeypatch.setattr("lapwing.plots.RESPONSE_FIGURES", ("impact_section",))
    monkeypatch.setattr("lapwing.plots.SWEEP_FIGURES", ())

    def broken(*_):
        raise RuntimeError("no ink")

    deck, out = write_deck(tmp_path), tmp_path / "r"
    with monkeypatch.context() as patch:
        patch.setattr(te_curve, "draw", broken)
        result = call("run", deck, "--out", out, "--threads", 1)
        assert result.exit_code == FAILED
        assert "small: figure te_curve: RuntimeError: no ink" in result.output
        names = {path.name for path in (out / "small").iterdir()}
        assert {"result.nc", "summary.md", "impact_section_one.png"} <= names
        assert not names & {"used.nml", "te_curve.png"}
        monkeypatch.setenv("OMP_NUM_THREADS", "1")
        again = call("plot", out / "small" / "result.nc", "--out", tmp_path / "p")
        assert again.exit_code == FAILED and "impact_section_one.pdf" in again.output
        assert "figure te_curve: RuntimeError: no ink" in again.output
    assert call("run", deck, "--out", out, "--threads", 1).exit_code == OK
    assert (out / "small" / "used.nml").exists()
