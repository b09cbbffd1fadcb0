"""Studies that the tests of reports look at, whole and damaged, computed once."""

from functools import cache

import pytest
from partial_data import whole_sweeps
from partial_studies import whole_responses, whole_searches


@pytest.fixture(scope="session")
def sweeps():
    return whole_sweeps()


@pytest.fixture(scope="session")
def responses():
    return whole_responses()


@pytest.fixture(scope="session")
def searches():
    return whole_searches()


@pytest.fixture(scope="session")
def damaged(request):
    """Callable(kind, name, damage): one of these studies with a damage, computed once, too."""
    return cache(lambda kind, name, damage: damage(request.getfixturevalue(kind)[name]))
