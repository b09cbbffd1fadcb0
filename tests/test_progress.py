"""What a batch log, and a terminal, tell of a run."""

import io
import threading

import pytest

import sketches
from lapwing import progress
from lapwing.deck import load_deck
from lapwing.drawing import plot_file
from lapwing.progress import MINUTE, PATIENCE, Bars, Lines
from lapwing.run import run_deck
from test_cli import write_deck

# Only ends a test whose line does not come.
NEVER = 60.0


class Log(io.StringIO):
    """A stream that says when the first line has come."""

    def __init__(self):
        super().__init__()
        self.spoken = threading.Event()

    def flush(self):
        super().flush()
        self.spoken.set()


@pytest.fixture
def hasty(monkeypatch):
    """A minute that is over at once."""
    monkeypatch.setattr(progress, "MINUTE", 0.0)
    monkeypatch.setattr(progress, "PATIENCE", 1e-3)


def test_a_line_at_once_and_one_a_minute():
    now, stream = [0.0], io.StringIO()
    lines = Lines("deck", stream, clock=lambda: now[0])
    lines.say("started")
    assert stream.getvalue() == "deck: started\n"
    report = lines.study("sweep torque", 200, "points")
    for second in range(0, 200, 10):
        now[0] = float(second)
        report(second / 200)
    lines.close()
    assert stream.getvalue().splitlines()[1:] == [
        f"deck: sweep torque: {100 * n * MINUTE / 200:.0f} % of 200 points" for n in (1, 2, 3)]


def test_a_study_that_reports_nothing_is_told_of_once_a_minute():
    now, stream = [0.0], io.StringIO()
    lines = Lines("deck", stream, clock=lambda: now[0])
    lines.study("responses", 1, "responses")
    for second in range(150):
        now[0] = float(second)
        lines.look()
    lines.study("critical T", 100, "%")(0.25)
    now[0] = 180.0
    lines.look()
    lines.close()
    now[0] = 999.0
    lines.look()
    assert stream.getvalue().splitlines() == [
        *["deck: responses: 0 % of 1 responses"] * 2, "deck: critical T: 25 %"]


def test_a_thread_looks_at_the_clock(hasty):
    stream = Log()
    lines = Lines("deck", stream)
    lines.study("critical T_safe", 100, "%")
    assert stream.spoken.wait(NEVER)
    lines.close()
    assert stream.getvalue().startswith("deck: critical T_safe: 0 %\n")


def test_a_thread_that_is_not_to_be_had_stops_no_study(monkeypatch):
    def refuse(_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    lines = Lines("deck", io.StringIO())
    lines.study("responses", 1, "responses")(1.0)
    lines.close()


@pytest.mark.parametrize(("seconds", "shown"), [(0.9 * PATIENCE, False), (PATIENCE, True)])
def test_a_bar_shows_what_takes_longer_than_a_second(capsys, seconds, shown):
    now = [0.0]
    bars = Bars(clock=lambda: now[0])
    bars.study("responses", 1, "responses")
    now[0] = seconds
    bars.look()
    bars.study("results", 100, "%")(1.0)
    bars.close()
    said = capsys.readouterr().err
    assert ("responses" in said and "100 %" in said) == shown and "results" not in said


def test_a_single_response_is_not_silent(tmp_path, hasty, monkeypatch):
    """The response does not go on before a line was written."""
    from lapwing.studies.response import study as home

    stream, original = Log(), home.prepared

    def slow(*given, **options):
        assert stream.spoken.wait(NEVER)
        return original(*given, **options)

    monkeypatch.setattr(home, "prepared", slow)
    monkeypatch.setattr("lapwing.plots.tasks_of", lambda _: [])
    lines = Lines("small", stream)
    run_deck(load_deck(write_deck(tmp_path)), tmp_path / "r", threads=1, progress=lines)
    lines.close()
    assert stream.getvalue().startswith("small: responses: 0 % of 1 responses\n")


def test_drawing_again_tells_how_far_it_is(tmp_path, monkeypatch):
    sketches.draw_two(monkeypatch)
    run_deck(load_deck(write_deck(tmp_path)), tmp_path / "r", threads=1, figures="none")
    monkeypatch.setattr(progress, "MINUTE", 0.0)
    stream = io.StringIO()
    lines = Lines("result.nc", stream)
    plot_file(tmp_path / "r" / "small" / "result.nc", progress=lines)
    lines.close()
    said = stream.getvalue().splitlines()
    assert "result.nc: figures: 50 %" in said and said[-1] == "result.nc: figures: 100 %"
