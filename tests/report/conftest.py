"""Studies that the tests of reports damage copies of, computed once."""

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
