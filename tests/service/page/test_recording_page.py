"""How ``softarm page`` refuses what it cannot show."""

import signal
from pathlib import Path

import pytest
from click.testing import CliRunner

pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

from softarm.cli.page import command
from softarm.estimator.errors import InputError
from softarm.page.playback import Instant
from softarm.page.recording import gauge_note
from tests.service.page.test_server import free_port

EXAMPLE = Path(__file__).parents[3] / "examples" / "recordings" / "sopra_pull"


def test_a_recording_without_estimates_is_refused_before_a_page_is_open():
    with pytest.raises(InputError, match="run softarm estimate RECORDING"):
        CliRunner().invoke(
            command,
            ["--recording", str(EXAMPLE), "--port", str(free_port())],
            standalone_mode=False,
            catch_exceptions=False,
        )
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.parametrize(("pull", "written"), [(None, ""), (0.1, "Force gauge: tip 0.100 N.")])
def test_a_gauge_is_written_once_it_has_read(pull, written):
    assert gauge_note(Instant((), (), (), (), {"tip": pull})) == written


@pytest.mark.parametrize(
    ("options", "refusal"),
    [
        (["--recording", str(EXAMPLE), "--arm", "sopra"], "either --recording, or --diagnosis, or --arm"),
        (["--recording", str(EXAMPLE), "--diagnosis", "out"], "either --recording, or --diagnosis"),
        (["--diagnosis", "out", "--specimen", "sopra"], "--specimen is for --recording"),
    ],
)
def test_what_does_not_fit_on_one_page_is_refused(options, refusal):
    refused = CliRunner().invoke(command, options)
    assert refused.exit_code == 2
    assert refusal in refused.output
