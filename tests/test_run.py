"""Carrying out a deck: what lies in its folder before, after and in between."""

import errno
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest

import children
import sketches
from lapwing.cli import BAD_INPUT, FAILED, OK, SURROUNDINGS
from lapwing.deck import load_deck
from lapwing.folder import FolderError, folder_of
from lapwing.results import DamagedFile, checksums, read_results
from lapwing.results.store import FolderLock, Manifest, staging_of
from lapwing.run import run_deck
from test_cli import call, write_deck

NAMES = {"result.nc", "used.nml", "summary.md", "manifest.json"}


# Options of runs whose folders are compared with each other.
ALL = ("--threads", 1, "--figures", "all")


@pytest.fixture(scope="module", autouse=True)
def two_figures():
    with pytest.MonkeyPatch.context() as patch:
        sketches.draw_two(patch)
        yield


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A deck and an undisturbed run of it."""
    folder = tmp_path_factory.mktemp("done")
    deck = write_deck(folder)
    run_deck(load_deck(deck), folder / "r", threads=1)
    return deck, folder / "r" / "small"


@pytest.fixture
def there(done, tmp_path):
    """A copy of its results, to be hurt; and a file of the user's among them."""
    shutil.copytree(done[1], tmp_path / "r" / "small")
    (tmp_path / "r" / "small" / "notes.txt").write_text("mine")
    return tmp_path / "r" / "small"


def again(done, there, *options):
    return call("run", done[0], "--out", there.parent, *ALL, *options)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def good(done, there):
    """Whether the folder holds what an undisturbed run writes, and the user's file."""
    found = contents(there)
    assert found.pop("notes.txt") == b"mine"
    expected = contents(done[1])
    # The manifest also says which names were the program's before.
    assert {**json.loads(found.pop("manifest.json")), "replaced": 0, "checksum": 0} == {
        **json.loads(expected.pop("manifest.json")), "replaced": 0, "checksum": 0}
    assert found == expected
    return [path.name for path in there.parent.iterdir()] == ["small"]


def test_the_manifest_lists_everything(done):
    manifest = Manifest.read(done[1])
    assert {*manifest.files, "manifest.json"} == {path.name for path in done[1].iterdir()}
    assert manifest.state == "complete" and not manifest.damaged(done[1])
    assert manifest.variables == checksums(done[1] / "result.nc")


# Whatever befalls the result file; of the others the loss and the change that no size tells of.
DAMAGE = [pytest.param(name, how, marks=() if name == "result.nc" or how in ("flip", "gone")
                       else pytest.mark.full)
          for name in ("result.nc", "used.nml", "summary.md", "te_curve.png", "manifest.json")
          for how in ("empty", "cut", "flip", "gone")]


@pytest.mark.parametrize(("name", "how"), DAMAGE)
def test_damage_is_noticed_said_and_made_good(done, there, name, how):
    path = there / name
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 4
    {"empty": lambda: path.write_bytes(b""), "cut": lambda: path.write_bytes(content[:-7]),
     "flip": lambda: path.write_bytes(content), "gone": path.unlink}[how]()
    if name == "result.nc" and how != "gone":
        with pytest.raises((DamagedFile, OSError)):
            read_results(path)
        assert call("plot", path).exit_code == BAD_INPUT
    result = again(done, there)
    assert result.exit_code == OK and "reused" not in result.output
    assert name in result.output and good(done, there)


def flipped(done, there, seeds):
    """Flip one bit of the result file, many times over; names those that went unnoticed."""
    whole, unnoticed = (there / "result.nc").read_bytes(), []
    for seed in seeds:
        rng, content = np.random.default_rng(seed), bytearray(whole)
        content[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
        (there / "result.nc").write_bytes(content)
        try:
            read_results(there / "result.nc").close()
            unnoticed.append(seed)
        except (OSError, ValueError):
            pass
    return unnoticed


def test_every_flipped_bit_is_noticed(done, there):
    assert flipped(done, there, range(40)) == []


@pytest.mark.full
def test_every_flipped_bit_is_noticed_many_times(done, there):
    assert flipped(done, there, range(5000)) == []


def test_a_result_file_alone_is_verified_by_its_own_checksums(done, tmp_path):
    path = tmp_path / "alone.nc"
    shutil.copy(done[1] / "result.nc", path)
    with read_results(path) as results:
        assert results.verified
    with netCDF4.Dataset(path, "a") as file:
        file["response_one"]["phi"][3] += 1e-12
        file["sweep_torque"].rtol = 1e-5
    with pytest.raises(DamagedFile, match=r"/response_one/phi, /sweep_torque$"):
        read_results(path)


def test_files_of_the_first_version_are_read_and_not_called_verified(done, tmp_path):
    path = tmp_path / "old.nc"
    shutil.copy(done[1] / "result.nc", path)
    with netCDF4.Dataset(path, "a") as file:
        for name in ("checksums", "schema_version", "interrupted", "engine_sha256"):
            file.delncattr(name)
    with read_results(path) as results:
        assert not results.verified and results.responses == ("one",)


def test_a_folder_of_the_first_version_is_taken_over(done, there):
    """No manifest: its figures are known by their names, everything else is the user's."""
    (there / "manifest.json").unlink()
    (there / "te_curve.png").write_bytes(b"an older drawing")
    assert "nothing there can be verified" in call(
        "run", done[0], "--out", there.parent, *ALL).output.replace(chr(10), " ")
    assert good(done, there)


def test_files_of_the_user_are_never_touched(done, tmp_path):
    folder = tmp_path / "r" / "small"
    folder.mkdir(parents=True)
    (folder / "gear_drawing.pdf").write_text("drawn by hand")
    result = call("run", done[0], "--out", tmp_path / "r", *ALL)
    assert result.exit_code == BAD_INPUT and "files of yours" in result.output.replace("\n", " ")
    assert contents(folder) == {"gear_drawing.pdf": b"drawn by hand"}


def test_what_the_user_adds_stays(done, there):
    (there / "more" / "deeper").mkdir(parents=True)
    (there / "more" / "deeper" / "photo.png").write_text("a photo")
    (there / "link").symlink_to("nowhere")
    assert again(done, there, "--set", "operation.brake_torque=6", "--force").exit_code == OK
    assert (there / "more" / "deeper" / "photo.png").read_text() == "a photo"
    assert os.readlink(there / "link") == "nowhere" and (there / "notes.txt").exists()
    assert [path.name for path in there.parent.iterdir()] == ["small"]


def test_a_name_that_the_user_has_taken_is_left_to_him(done, there):
    """A figure of the new values would be named like a file of the user's."""
    (there / "history_two.png").write_text("mine")
    result = again(done, there, "--set", "response.one.name=two", "--force")
    assert result.exit_code == FAILED and "a file of yours is named" in result.output
    assert (there / "history_two.png").read_text() == "mine"
    assert (there / "history_two.pdf").exists()
    assert not (there / "history_one.pdf").exists()


@pytest.mark.parametrize("name", ["..nml", "...nml", ".hidden.nml"])
def test_a_deck_without_a_name_of_its_own_is_refused(tmp_path, name):
    deck, out = write_deck(tmp_path, name), tmp_path / "r" / "s"
    out.mkdir(parents=True)
    (out / "mine.png").write_text("mine")
    result = call("run", deck, "--out", out)
    assert result.exit_code == BAD_INPUT and "begin with a dot" in result.output.replace("\n", " ")
    assert [path.name for path in out.iterdir()] == ["mine.png"]


def test_a_file_in_the_place_of_the_folder_is_refused(done, tmp_path):
    (tmp_path / "small").write_text("mine")
    assert call("run", done[0], "--out", tmp_path).exit_code == BAD_INPUT
    assert (tmp_path / "small").read_text() == "mine"


def test_a_second_run_is_refused_and_told_of_the_first(done, there):
    """The lock dies with its holder, a process that is killed."""
    holder = subprocess.Popen(
        [sys.executable, "-c", "import sys; from lapwing.results.store import FolderLock\n"
         f"lock = FolderLock({str(there)!r}); print('held', flush=True); sys.stdin.read()"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert holder.stdout.readline() == b"held\n"
    before = contents(there)
    result = again(done, there, "--force")
    assert result.exit_code == BAD_INPUT and f"process {holder.pid} on" in result.output
    assert contents(there) == before
    holder.kill()
    holder.communicate()
    assert again(done, there).exit_code == OK
    assert good(done, there)


def test_the_lock_may_be_taken_again_in_one_process(tmp_path):
    with FolderLock(tmp_path / "a"):
        pass
    with FolderLock(tmp_path / "a"):
        assert [path.name for path in tmp_path.iterdir()] == [".a.lock"]
    assert list(tmp_path.iterdir()) == []


STOPS = ("lapwing.studies.of_deck:compute", "lapwing.results:write_results",
         "lapwing.report.summary:summary_text", "lapwing.plots:attempt",
         "lapwing.results.store:Manifest.write", "lapwing.results.store:_bring_along",
         "lapwing.results.store:_exchange", "lapwing.results.store:_dissolve")
KILLED = """
import functools, importlib, os, signal, sys
from pathlib import Path
module, _, path = {stop!r}.partition(":")
owner = importlib.import_module(module)
*parts, name = path.split(".")
for part in parts:
    owner = getattr(owner, part)
original = getattr(owner, name)

@functools.wraps(original)
def stopped(*given, **more):
    if {after}:
        original(*given, **more)
    os.kill(os.getpid(), signal.SIGKILL)

setattr(owner, name, stopped)
import pytest, sketches
sketches.draw_two(pytest.MonkeyPatch())
from lapwing.deck import load_deck
from lapwing.run import run_deck
deck = load_deck({deck!r}, [("operation.brake_torque", "6")])
run_deck(deck, {out!r}, threads=1, force=True)
"""


# Before a step is mostly after the one before it: some places are enough for every day.
EVERY_DAY = {(STOPS[3], False), (STOPS[4], True), (STOPS[6], False),
             (STOPS[6], True)}


@pytest.mark.parametrize(("stop", "after"), [
    pytest.param(stop, after, marks=[] if (stop, after) in EVERY_DAY else pytest.mark.full)
    for stop in STOPS for after in (False, True)])
def test_a_kill_leaves_the_old_or_the_new(done, there, stop, after):
    """Killed before or after each step of a publication; the next run takes up what is left."""
    code = KILLED.format(stop=stop, after=after, deck=str(done[0]), out=str(there.parent))
    ended = children.carried_out(code)
    assert ended.code == -9, ended.said
    assert (there / "notes.txt").read_text() == "mine"
    manifest = Manifest.read(there)
    assert not manifest.damaged(there) and manifest.state == "complete"
    with read_results(there / "result.nc") as results:
        assert results.verified
    assert again(done, there, "--force").exit_code == OK
    assert good(done, there)


@pytest.mark.parametrize("exchange", ["renameat2", "two renames"])
def test_a_kill_between_two_renames_is_made_good(done, there, exchange, monkeypatch):
    """Where the system cannot exchange two names, the results have a third one for a moment."""
    old = there.parent / ".small.old"
    if exchange == "two renames":
        there.rename(old)
        (there.parent / ".small.new").mkdir()
        (there.parent / ".small.new" / ".making").touch()
    assert again(done, there).exit_code == OK
    assert good(done, there)


def test_without_an_exchange_in_one_step_the_same_is_published(done, there, monkeypatch):
    monkeypatch.setattr("lapwing.results.store.sys.platform", "other")
    assert again(done, there, "--force").exit_code == OK
    assert good(done, there)


def test_leftovers_of_dead_runs_go(done, there):
    (there / ".result.nc.12345.tmp").write_text("half")
    staging = staging_of(there)
    staging.mkdir()
    (staging / ".making").touch()
    (staging / "result.nc").write_text("half")
    assert again(done, there).exit_code == OK and good(done, there)


def test_an_empty_used_deck_needs_no_force(done, there):
    (there / "used.nml").write_text("")
    assert again(done, there).exit_code == OK and good(done, there)
    (there / "used.nml").write_text("")
    (there / "manifest.json").unlink()
    assert again(done, there).exit_code == OK and good(done, there)


def interrupted_run(deck, out, monkeypatch, **options):
    """Run a deck that a signal stops in its sweep."""
    def stop(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("lapwing.studies.sweep.study.sweep", stop)
        return run_deck(load_deck(deck, options.pop("overrides", ())), out, threads=1, **options)


def test_an_interrupted_run_goes_on_where_it_stopped(done, tmp_path, monkeypatch):
    out = tmp_path / "r"
    outcome = interrupted_run(done[0], out, monkeypatch)
    assert outcome.interrupted and not outcome.reused
    assert {path.name for path in outcome.folder.iterdir()} == NAMES
    with read_results(outcome.folder / "result.nc") as results:
        assert results.interrupted and results.responses == ("one",) and results.sweeps == ()
        (kind, name), = results.missing
        assert kind == "sweep"
    said = (outcome.folder / "summary.md").read_text(encoding="utf-8")
    assert f"before all studies of the deck were finished. No result: sweep `{name}`." in said
    assert outcome.headlines[-1] == f"{name}: not finished, no result"
    with monkeypatch.context() as patch:
        patch.setattr("lapwing.studies.response.study.prepared", None)  # is not computed again
        outcome = run_deck(load_deck(done[0]), out, threads=1)
    assert not outcome.interrupted and "1 finished study taken over" in outcome.notes[0]
    assert checksums(out / "small" / "result.nc") == checksums(done[1] / "result.nc")
    found, expected = contents(out / "small"), contents(done[1])
    assert all(found[name] == expected[name] for name in expected
               if name not in ("result.nc", "manifest.json"))


def test_unfinished_results_do_not_replace_complete_ones(done, there, monkeypatch):
    before = contents(there)
    other = [("operation.brake_torque", "6")]
    outcome = interrupted_run(done[0], there.parent, monkeypatch, force=True, overrides=other)
    assert outcome.folder.name == "small.interrupted" and contents(there) == before
    with pytest.raises(FolderError, match="other values"):
        run_deck(load_deck(done[0], other), there.parent, threads=1)
    run_deck(load_deck(done[0], other), there.parent, threads=1, force=True)
    assert [path.name for path in there.parent.iterdir()] == ["small"]


def test_a_signal_while_drawing_keeps_the_results(done, tmp_path, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    out = tmp_path / "r"
    with monkeypatch.context() as patch:
        patch.setattr("lapwing.plots.Drawing.finish", stop)
        assert run_deck(load_deck(done[0]), out, threads=1).interrupted
    with read_results(out / "small" / "result.nc") as results:
        assert not results.interrupted
    with monkeypatch.context() as patch:
        for study in ("response.study.prepared", "sweep.study.sweep"):
            patch.setattr(f"lapwing.studies.{study}", None)
        assert not run_deck(load_deck(done[0]), out, threads=1).interrupted
    assert contents(out / "small").keys() == contents(done[1]).keys()


FULL_DISK = """
import resource, signal, sys
import pytest, sketches
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
sketches.draw_two(pytest.MonkeyPatch())
from lapwing.deck import load_deck
from lapwing.run import run_deck
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
try:
    run_deck(load_deck({deck!r}), {out!r}, threads=1, force=True)
except OSError as error:
    sys.exit(f"said: {{error.strerror}}")
"""


@pytest.mark.parametrize("size", [0, 3000, 30_000])
def test_no_room_for_new_files_leaves_the_old_ones(done, there, size):
    """A bound of a file's size stands for a full disk."""
    before = contents(there)
    code = FULL_DISK.format(size=size, deck=str(done[0]), out=str(there.parent))
    ended = children.carried_out(code)
    assert ended.code in (0, 1) and "Traceback" not in ended.said, ended.said
    if ended.code:
        assert "said: File too large" in ended.said and contents(there) == before
    assert again(done, there).exit_code == OK and good(done, there)


def test_figures_without_room_are_named_and_the_numbers_kept(done, tmp_path,
                                                             monkeypatch):
    """The first figure finds the disk full; the next run has room and draws it alone."""
    from lapwing.plots import style

    original = style.save

    def save(figure, *paths):
        if "history" in paths[0].name:
            paths[0].write_bytes(b"half")
            raise OSError(errno.ENOSPC, "No space left on device", str(paths[0]))
        original(figure, *paths)

    folder = tmp_path / "r" / "small"
    with monkeypatch.context() as patch:
        patch.setattr(style, "save", save)
        result = call("run", done[0], "--out", folder.parent, *ALL)
    assert result.exit_code == SURROUNDINGS
    assert "figure history_one: OSError: [Errno 28]" in result.output
    lost = {"history_one.png", "history_one.pdf"}
    expected = contents(done[1])
    assert contents(folder).keys() == expected.keys() - lost
    manifest = Manifest.read(folder)
    assert manifest.state == "incomplete" and not manifest.damaged(folder)
    with monkeypatch.context() as patch:
        for study in ("response.study.prepared", "sweep.study.sweep"):
            patch.setattr(f"lapwing.studies.{study}", None)
        assert call("run", done[0], "--out", folder.parent, *ALL).exit_code == OK
    found = contents(folder)
    assert found.pop("manifest.json") and expected.pop("manifest.json") and found == expected


def test_results_that_lack_figures_for_want_of_room_replace_no_complete_ones(
        done, there, monkeypatch):
    from lapwing.plots import style

    def save(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    before = contents(there)
    with monkeypatch.context() as patch:
        patch.setattr(style, "save", save)
        result = again(done, there, "--set", "operation.brake_torque=6", "--force")
    assert result.exit_code == SURROUNDINGS and "No space left on device" in result.output
    assert contents(there) == before and [path.name for path in there.parent.iterdir()] == ["small"]


REDRAWN_WITHOUT_ROOM = """
import resource, signal, sys
import pytest, sketches
from lapwing.__main__ import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
sketches.draw_two(pytest.MonkeyPatch())
sys.argv = ["lapwing", "plot", {path!r}]
resource.setrlimit(resource.RLIMIT_FSIZE, (sketches.SIZE - 1000, sketches.SIZE - 1000))
main()
"""


def test_figures_drawn_again_without_room_are_of_the_surroundings(done, there):
    """The old ones stay as they are."""
    before = contents(there)
    ended = children.carried_out(REDRAWN_WITHOUT_ROOM.format(path=str(there / "result.nc")))
    assert ended.code == SURROUNDINGS and "File too large" in ended.said, ended.said
    assert "Traceback" not in ended.said
    found = contents(there)
    assert all(found[name] == before[name] for name in before if name != "manifest.json")
    assert not Manifest.read(there).damaged(there)


def test_figures_are_drawn_again_from_the_file_and_listed(done, there):
    (there / "te_curve.png").unlink()
    assert call("plot", there / "result.nc").exit_code == OK
    assert not Manifest.read(there).damaged(there)
    result = again(done, there)
    assert "reused" in result.output and good(done, there)


# Figures of another version, so to say: drawn more coarsely.  Killed at the given step.
REDRAWN = """
import os, signal
import pytest, sketches
from lapwing.plots import style
from lapwing.results import store
sketches.draw_two(pytest.MonkeyPatch())
style.DPI = 40
left, replace = {step}, os.replace

def counted(*names):
    global left
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    left -= 1
    replace(*names)

store.os.replace = counted
from lapwing.drawing import plot_file
plot_file({path!r})
"""


@pytest.mark.parametrize("step", [0, 1, 3, 5])
def test_a_kill_while_figures_are_replaced_damages_none(done, there, step):
    """Two figures in two formats between two writings of the manifest: six steps."""
    (there / "te_curve.pdf").unlink()
    code = REDRAWN.format(step=step, path=str(there / "result.nc"))
    ended = children.carried_out(code)
    assert ended.code == -9, ended.said
    old, manifest = contents(done[1]), Manifest.read(there)
    changed = {name for name, content in contents(there).items()
               if name in old and name != "manifest.json" and content != old[name]}
    assert len(changed) == max(step - 1, 0)
    lacking = {} if (there / "te_curve.pdf").exists() else {"te_curve.pdf": "missing"}
    assert manifest.damaged(there) == lacking and len(lacking) == (step < 5)
    result = again(done, there)
    assert result.exit_code == OK and "has changed" not in result.output
    assert call("plot", there / "result.nc").exit_code == OK and good(done, there)


def test_a_file_of_the_users_with_the_name_of_a_figure_that_was_coming_is_his(done, there):
    manifest = Manifest.read(there)
    manifest.coming["extra.png"] = {"size": 4, "sha256": "0" * 64}
    manifest.write(there)
    (there / "extra.png").write_text("mine")
    assert again(done, there, "--force").exit_code == OK
    assert (there / "extra.png").read_text() == "mine"


def test_figures_elsewhere_spare_what_is_there(done, tmp_path):
    folder = tmp_path / "figures"
    folder.mkdir()
    (folder / "te_curve.png").write_text("mine")
    for _ in range(2):
        result = call("plot", done[1] / "result.nc", "--out", folder)
        assert result.exit_code == FAILED and "te_curve.png; it is left" in result.output
    assert (folder / "te_curve.png").read_text() == "mine" and (folder / "te_curve.pdf").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figures"]


def test_folders_are_told_by_the_deck(tmp_path):
    assert folder_of("small", tmp_path) == tmp_path / "small"
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    assert folder_of("link", tmp_path) == Path(os.path.realpath(tmp_path)) / "elsewhere"


def test_a_figure_that_fails_leaves_the_others_and_is_named(tmp_path, monkeypatch):
    """The next run does not take these results for complete."""
    def broken(figure, *given, **more):
        if figure.endswith("history"):
            raise RuntimeError("no ink")
        return sketches.figure_of(figure, *given, **more)

    deck, out = write_deck(tmp_path), tmp_path / "r"
    with monkeypatch.context() as patch:
        patch.setattr("lapwing.plots.figure_of", broken)
        result = call("run", deck, "--out", out, *ALL)
        assert result.exit_code == FAILED
        assert "small: figure history_one: RuntimeError: no ink" in result.output
        names = {path.name for path in (out / "small").iterdir()}
        assert {"result.nc", "summary.md", "te_curve.png"} <= names
        assert "history_one.png" not in names
        summary = (out / "small" / "summary.md").read_text(encoding="utf-8")
        first, = re.findall(r"Figure to look at first: \[(.*?)\]", summary)
        assert first in names and "history_one.png" not in summary
        again = call("plot", out / "small" / "result.nc", "--out", tmp_path / "p")
        assert again.exit_code == FAILED and "te_curve.pdf" in again.output
        assert "figure history_one: RuntimeError: no ink" in again.output
    assert call("run", deck, "--out", out, *ALL).exit_code == OK
    assert (out / "small" / "history_one.png").exists()
