"""What several test files share by name."""

import signal
from functools import partial

import pytest

import lapwing


@pytest.fixture(params=["exact", "rk4"])
def method(request, monkeypatch):
    """Both ways of moving along a smooth piece: `simulate` of the test's file takes this one."""
    monkeypatch.setattr(request.module, "simulate",
                        partial(lapwing.simulate, method=request.param))
    return request.param


@pytest.fixture
def hears_ctrl_c():
    """Ctrl-C interrupts the test, also where `make test &` ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
