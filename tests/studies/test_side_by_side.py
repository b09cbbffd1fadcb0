"""Calls side by side: their order, their errors, their interruption."""

import _thread
import threading

import pytest

from lapwing.studies.side_by_side import side_by_side


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
def test_an_interruption_reaches_every_thread_and_keeps_what_is_finished(threads, hears_ctrl_c):
    """Item 0 is short, the others go on until they are interrupted."""
    before = threading.active_count()
    begun, first = threading.Semaphore(0), threading.Event()

    def work(x):
        if x == 0:
            return x
        first.wait()  # the one item that ends has ended
        begun.release()
        while True:  # in steps that can be interrupted; the guard of the test run ends a failure
            threading.Event().wait(0.01)

    def interrupt():
        for _ in range(threads):
            begun.acquire()
        _thread.interrupt_main()

    threading.Thread(target=interrupt).start()
    found, complete = side_by_side(work, range(6), threads, lambda _: first.set())
    assert not complete and found == {0: 0}
    assert threading.active_count() <= before + 1  # the one that interrupted may not have ended


@pytest.mark.parametrize("handed_out", [0, 1, 2, 5])
def test_an_interruption_while_calls_are_handed_out_is_one(handed_out, monkeypatch):
    """It neither leaves the function as an exception nor a thread at work."""
    from lapwing.studies import side_by_side as module

    class Interrupted(module.ThreadPoolExecutor):
        def submit(self, *given):
            submitted.append(given)
            if len(submitted) > handed_out:
                # A thread may have begun of which the pool does not know yet.
                thread = threading.Thread(target=given[0], args=given[1:])
                others.append(thread)
                thread.start()
                raise KeyboardInterrupt
            return super().submit(*given)

    def never(_):
        called.append(1)

    called, submitted, others = [], [], []
    monkeypatch.setattr(threading, "excepthook", lambda _: None)  # the thread ends by Ctrl-C
    monkeypatch.setattr(module, "ThreadPoolExecutor", Interrupted)
    before = threading.active_count()
    assert side_by_side(never, range(6), 2, ignore) == ({}, False)
    others[0].join(20)
    assert not called and threading.active_count() == before


def test_an_interruption_tears_no_module_that_is_being_loaded(tmp_path, monkeypatch, hears_ctrl_c):
    """A thread is at the middle of an import when Ctrl-C comes: the module is whole afterwards."""
    import sys

    from lapwing.studies import side_by_side as module

    (tmp_path / "slow_to_load.py").write_text(
        "import gate\ngate.inside.set()\ngate.go.wait(20)\nfor _ in range(10000):\n    pass\n"
        "whole = True\n", encoding="utf-8")
    (tmp_path / "gate.py").write_text(
        "import threading\ninside, go = threading.Event(), threading.Event()\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    import gate

    # The loading goes on once it has been seen that something is being loaded.
    looks = []
    original = module.time.sleep
    monkeypatch.setattr(module.time, "sleep", lambda seconds: (looks.append(1), gate.go.set(),
                                                               original(seconds)))

    def work(_):
        import slow_to_load  # noqa: F401 - the loading is what is looked at

        while True:
            threading.Event().wait(0.01)

    def interrupt():
        gate.inside.wait()
        _thread.interrupt_main()

    threading.Thread(target=interrupt).start()
    found, complete = side_by_side(work, range(1), 1, ignore)
    assert looks and not complete and found == {}
    assert sys.modules["slow_to_load"].whole
    for name in ("slow_to_load", "gate"):
        del sys.modules[name]
