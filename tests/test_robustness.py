"""Damage, kills, signals and full disks: a few of each kind, and under `full` some hundred.

By hand, with other numbers or seeds: `python tests/robustness.py --seed 1 kill=20`.
"""

import os

import pytest

from robustness import COUNTS, survey

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks for processes in /proc")]


@pytest.mark.parametrize("kind", COUNTS)
def test_every_end_leaves_good_results_or_none(kind, capsys):
    def say(text):
        with capsys.disabled():
            print(f"\n{text}", end="")

    failures = survey({kind: COUNTS[kind]}, say=say)
    assert not failures, "\n\n".join(failures)
