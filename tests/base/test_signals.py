"""Signals: raised once, held where they must be, never lost."""

import signal
import threading

import pytest

from lapwing.base.signals import SIGNALS, Stopped, check, heard, held, listen


def handlers():
    return [signal.getsignal(signum) for signum in SIGNALS]


@pytest.fixture(autouse=True)
def restored():
    """No test leaves a handler behind; Ctrl-C is heard even where `make test &` ignores it."""
    before = handlers()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    inside = handlers()
    yield
    assert handlers() == inside
    for signum, handler in zip(SIGNALS, before, strict=True):
        signal.signal(signum, handler)


@pytest.mark.parametrize("signum", SIGNALS)
def test_a_signal_stops_and_says_which(signum):
    with listen():
        with pytest.raises(Stopped) as stopped:
            signal.raise_signal(signum)
        assert heard() == signum
    assert stopped.value.signum == signum and heard() is None
    assert isinstance(stopped.value, KeyboardInterrupt)


@pytest.mark.parametrize("signum", SIGNALS)
def test_a_held_signal_comes_at_the_end_of_the_block(signum):
    done = []
    with pytest.raises(Stopped) as stopped, listen(), held():
        with held():
            signal.raise_signal(signum)
        done.append("inner")
        signal.raise_signal(signal.SIGINT)  # the first one counts
        done.append("all")
    assert done == ["inner", "all"] and stopped.value.signum == signum


def test_a_second_signal_disturbs_no_stopping():
    done = []
    with listen():
        try:
            signal.raise_signal(signal.SIGTERM)
        except Stopped:
            for signum in SIGNALS:
                signal.raise_signal(signum)
            with held():
                signal.raise_signal(signal.SIGINT)
            done.append("written")
    assert done == ["written"]


def test_holding_without_listening_defers_too():
    done = []
    with pytest.raises(KeyboardInterrupt), held():
        signal.raise_signal(signal.SIGINT)
        done.append("written")
    assert done == ["written"]


def test_an_error_while_held_is_not_hidden_and_the_signal_is_not_lost():
    with listen():
        with pytest.raises(OSError), held():
            signal.raise_signal(signal.SIGTERM)
            raise OSError("disk full")
        with pytest.raises(Stopped):
            check()


def test_a_signal_swallowed_by_a_bare_except_is_found_again():
    with listen():
        try:
            signal.raise_signal(signal.SIGTERM)
        except BaseException:
            pass
        with pytest.raises(Stopped):
            check()


def test_a_signal_lost_in_a_destructor_comes_again(capsys):
    class Fragile:
        def __del__(self):
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(Stopped), listen():
        Fragile()
        threading.Event().wait()  # for ever, but for the signal
    assert capsys.readouterr().err == ""


def test_what_is_ignored_stays_ignored():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with listen():
        signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN and heard() is None
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_in_another_thread_nothing_is_installed():
    before, seen = handlers(), []

    def work():
        with listen(), held():
            seen.append(handlers())
            check()

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]


def test_listening_twice_is_listening_once():
    with listen():
        with listen():
            inside = handlers()
        assert handlers() == inside
        with pytest.raises(Stopped):
            signal.raise_signal(signal.SIGTERM)
        assert heard() == signal.SIGTERM


def test_a_module_that_is_being_loaded_is_not_torn(tmp_path, monkeypatch):
    """The signal comes while it is loaded; it is raised once that is done."""
    (tmp_path / "loaded_slowly.py").write_text(
        "import signal\nsignal.raise_signal(signal.SIGTERM)\nwhole = True\n")
    monkeypatch.syspath_prepend(tmp_path)
    never = threading.Event()
    with pytest.raises(Stopped), listen():
        import loaded_slowly

        assert loaded_slowly.whole
        while True:
            never.wait(0.01)
