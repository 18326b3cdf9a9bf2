"""A notebook may allow BLAS many threads; an identification takes one meanwhile, as the command does, for the same
bits."""

import pytest
from experiment_file.small_experiment import write_experiment
from threadpoolctl import threadpool_info, threadpool_limits

from idic.run import Console, identify_run


def threads():
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


class Seen(Exception):
    """Enough was seen."""


def test_an_identification_limits_blas_to_one_thread_and_gives_it_back(tmp_path):
    during = []

    def say(text):
        during.append(threads())
        raise Seen

    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with pytest.raises(Seen):
            identify_run(write_experiment(tmp_path / "test"), tmp_path / "run", console=Console(say))
        assert during == [{1}] and threads() == before == {2}
