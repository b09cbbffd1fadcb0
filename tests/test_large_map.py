"""The run that `tests/large_map.py` judges, with few values."""

import argparse

import pytest

from large_map import judge

pytestmark = pytest.mark.full


def test_a_map_that_was_killed_is_whole_small_and_quick(tmp_path, capsys):
    def say(text):
        with capsys.disabled():
            print(f"\n{text}", end="")

    assert not judge(argparse.Namespace(side=40, kills=2, threads=2, samples=3, settle=None,
                                             record=None), tmp_path, say)
