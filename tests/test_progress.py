"""What a batch log tells of a run."""

import io

from lapwing.progress import MINUTE, Lines


def test_a_line_at_once_and_one_a_minute():
    now, stream = [0.0], io.StringIO()
    lines = Lines("deck", stream, clock=lambda: now[0])
    lines.say("started")
    assert stream.getvalue() == "deck: started\n"
    report = lines.study("sweep torque", 200, "points")
    for second in range(0, 200, 10):
        now[0] = float(second)
        report(second / 200)
    assert stream.getvalue().splitlines()[1:] == [
        f"deck: sweep torque: {100 * n * MINUTE / 200:.0f} % of 200 points" for n in (1, 2, 3)]
