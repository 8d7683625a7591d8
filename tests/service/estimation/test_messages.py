"""Messages between the control process and that of the estimator."""

import pickle
from dataclasses import replace

import numpy as np

from softarm.daemon.estimation.messages import EstimationRequest
from tests.service.standins import result

REQUEST = EstimationRequest(
    1.5,
    7,
    np.array([1.0, np.nan]),
    np.arange(6.0),
    np.array([0.0, 0.0, 9.81]),
    ("orientation_tip",),
    tare=None,
)


def test_a_message_arrives_as_it_was_sent():
    nodes = np.arange(12, dtype=np.float32).reshape(4, 3)[:, ::-1]
    sent = replace(result(REQUEST), nodes=nodes)
    arrived = pickle.loads(pickle.dumps(sent, pickle.HIGHEST_PROTOCOL))
    for before, after in ((sent, arrived), (sent.request, arrived.request)):
        assert vars(before).keys() == vars(after).keys()
    for name, value in {**vars(sent), **vars(sent.request)}.items():
        other = vars(arrived).get(name, vars(arrived.request).get(name))
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(other, value)
            assert other.dtype == value.dtype
            assert other.flags.writeable  # a compiled kernel is another one for arrays that are not
    assert arrived.request.used == REQUEST.used
    assert arrived.hold.note == sent.hold.note
