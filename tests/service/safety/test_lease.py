import pytest
from hypothesis import given
from hypothesis import strategies as st

from softarm.daemon.safety.lease import LeaseError, LeaseManager

SECOND = 1_000_000_000


def test_one_holder_at_a_time():
    desk = LeaseManager(duration_s=1.0)
    lease = desk.acquire("ann", now_ns=0)
    with pytest.raises(LeaseError) as refusal:
        desk.acquire("bob", now_ns=SECOND // 2)
    assert refusal.value.code == "lease_held"
    desk.check(lease.token, now_ns=SECOND - 1)
    with pytest.raises(LeaseError):
        desk.check("guess", now_ns=0)


def test_runs_out_once():
    desk = LeaseManager(duration_s=1.0)
    desk.acquire("ann", now_ns=0)
    assert desk.expire(SECOND - 1) is None
    gone = desk.expire(SECOND)
    assert gone is not None
    assert gone.holder == "ann"
    assert desk.expire(SECOND) is None
    assert desk.acquire("bob", now_ns=SECOND).token != gone.token


@given(st.lists(st.integers(min_value=1, max_value=SECOND - 1), max_size=20))
def test_renewing_in_time_keeps_the_token(gaps):
    desk = LeaseManager(duration_s=1.0)
    now, lease = 0, desk.acquire("ann", now_ns=0)
    for gap in gaps:
        now += gap
        renewed = desk.acquire("ann", now_ns=now, token=lease.token)
        assert renewed.token == lease.token
        assert renewed.expires_ns == now + SECOND


def test_release_needs_the_token():
    desk = LeaseManager(duration_s=1.0)
    lease = desk.acquire("ann", now_ns=0)
    with pytest.raises(LeaseError):
        desk.release("guess", now_ns=0)
    desk.release(lease.token, now_ns=0)
    assert desk.holder(0) is None


def test_repeated_sequence_is_refused():
    desk = LeaseManager(duration_s=1.0)
    desk.acquire("ann", now_ns=0)
    assert [desk.accept_sequence(n) for n in (0, 1, 1, 0, 5)] == [True, True, False, False, True]
