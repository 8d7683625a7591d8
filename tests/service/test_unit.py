"""What the service exchanges with systemd: notifications, and folders that it may write."""

import socket

import pytest

from softarm.cli import run, serve
from softarm.daemon.notify import Notifier
from softarm.estimator.specimen import load_specimen
from tests.service.test_serve import CONFIG


@pytest.fixture
def supervisor(tmp_path, monkeypatch):
    """A supervisor's socket whose path has an @ in its middle."""
    path = tmp_path / "podman@x" / "notify"
    path.parent.mkdir()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.bind(str(path))
        end.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(path))
        yield end


def test_an_at_sign_stands_for_an_abstract_socket_only_at_the_beginning(supervisor):
    notifier = Notifier.from_environment()
    notifier.ready("up")
    notifier.close()
    assert supervisor.recv(100) == b"READY=1\nSTATUS=up"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as abstract:
        abstract.bind("\0softarm-test-notify@2")
        notifier = Notifier("@softarm-test-notify@2")
        notifier.watchdog()
        notifier.close()
        assert abstract.recv(100) == b"WATCHDOG=1"


def test_ready_that_the_supervisor_did_not_take_is_sent_again_with_the_watchdog(supervisor):
    now_s = [0.0]
    notifier = Notifier(supervisor.getsockname(), lambda: now_s[0])
    sent = 0
    while notifier._send("WATCHDOG=1"):
        sent += 1
    notifier.ready("up")
    for _ in range(sent):
        assert supervisor.recv(100) == b"WATCHDOG=1"
    for _ in range(50):  # a tick every 10 ms
        notifier.watchdog()
        now_s[0] += 0.01
    notifier.close()
    told = [supervisor.recv(100) for _ in range(4)]
    assert told == [b"READY=1\nSTATUS=up", *[b"WATCHDOG=1"] * 3]
    with pytest.raises(BlockingIOError):
        supervisor.recv(100)


def test_fitting_a_rod_asks_for_more_time_and_must_be_kept(supervisor, tmp_path, monkeypatch):
    def fit(specimen, progress):
        progress(1, 2)
        progress(2, 2)

    monkeypatch.setattr(serve, "trusted_rod", fit)  # the fit itself takes minutes and is tested elsewhere
    monkeypatch.setattr(serve, "known_trusted_rod", lambda _: None)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(serve.WorkFailedError, match=r"cannot be kept there.*XDG_CACHE_HOME"):
        serve._fit_rod(load_specimen("sopra"))
    asked = [supervisor.recv(100) for _ in range(2)]
    assert asked == [b"EXTEND_TIMEOUT_USEC=300000000"] * 2


@pytest.mark.parametrize("field", ["state_directory", "recording_directory"])
def test_a_folder_that_cannot_be_written_is_refused_at_the_start(field, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    path = tmp_path / "service.toml"
    path.write_text(f'{field} = "file/below"\n' + CONFIG.format(port=1, nobody=1))
    assert run(["serve", "--config", str(path)]) == 2
    told = capsys.readouterr().err
    assert f"{field}: {tmp_path}/file/below cannot be written (Not a directory)" in told
    assert told.count("\n") == 1
