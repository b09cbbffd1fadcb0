"""The result file that the tests of figures look at, computed once."""

import pytest
from plot_data import make_results


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    with make_results(tmp_path_factory.mktemp("plots")) as results:
        yield results
