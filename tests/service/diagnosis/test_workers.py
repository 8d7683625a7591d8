"""The same work, in this process, in others, or on a Dask cluster."""

import os
import threading

import pytest

from softarm.analysis.diagnosis.workers import workers
from softarm.estimator.errors import InputError


def test_work_in_this_process_hands_on_its_errors() -> None:
    with workers(1) as executor:
        assert list(executor.map(abs, [-1, 2])) == [1, 2]
        with pytest.raises(ZeroDivisionError):
            executor.submit(divmod, 1, 0).result()


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_work_on_a_local_dask_cluster_gives_the_same() -> None:
    distributed = pytest.importorskip("distributed")
    settings = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**settings) as cluster, workers(2, cluster.scheduler_address) as executor:
        assert list(executor.map(abs, [-1, 2, -3])) == [1, 2, 3]
        processes = set(executor.map(_process_after, [0.2, 0.21]))
    assert len(processes) == 2
    assert os.getpid() not in processes


def _process_after(seconds: float) -> int:
    """Be busy for so long, so that the next task goes to another worker."""
    threading.Event().wait(seconds)
    return os.getpid()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere"])
def test_a_scheduler_that_is_not_there_is_named(address: str) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="no scheduler answers"), workers(2, address, patience=0.5):
        pass
