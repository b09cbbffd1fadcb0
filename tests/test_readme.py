"""The Python of README.md works as it stands there."""

import re

import matplotlib

from helpers import ROOT


def test_the_examples_run_one_after_the_other(tmp_path, monkeypatch, capsys):
    matplotlib.use("agg")
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.S)
    assert len(blocks) >= 2
    code = "".join(blocks).replace('"inputs/', f'"{ROOT.as_posix()}/inputs/')
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})  # as a reader types it
    said = capsys.readouterr().out
    # What the comments in it promise.
    assert "OK [3 3 3]" in said
    assert (tmp_path / "backlash.png").stat().st_size > 10_000
    assert "impact" in (tmp_path / "events.csv").read_text().splitlines()[2]
