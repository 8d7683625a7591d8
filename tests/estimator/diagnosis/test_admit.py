import numpy as np
import pytest

from estimator.diagnosis.admit import admit
from estimator.errors import InputError
from estimator.recording import Recording
from estimator.specimen import load_specimen

SOPRA = load_specimen("sopra")


def _recording(seconds: float = 30.0, bend: float = 0.3, **info) -> Recording:
    time = np.arange(0.0, seconds, 0.05)
    moved = bend * np.sin(time)
    return Recording("run", time, {"bend_tip_x_rad": moved, "bend_tip_y_rad": 0.5 * moved}, info)


def test_a_moving_recording_is_admitted() -> None:
    assert admit([_recording()], [], SOPRA).suspects[0].name == "run"


@pytest.mark.parametrize(
    ("recording", "words"),
    [(_recording(seconds=0.4), "too short"), (_recording(bend=0.0), "nothing moves")],
)
def test_what_cannot_decide_is_refused_with_what_is_missing(recording: Recording, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        admit([recording], [], SOPRA)
    assert "record" in str(caught.value)


def test_a_recording_of_another_specimen_is_refused() -> None:
    other = Recording(
        "run",
        np.arange(0.0, 30.0, 0.1),
        {f"pressure_{k}_pa": np.zeros(300) for k in range(9)},
        {"specimen": "other"},
    )
    with pytest.raises(InputError, match="was recorded on 'other'"):
        admit([other], [], SOPRA)


def test_gaps_and_jumps_of_the_clock_are_told() -> None:
    plain = _recording()
    time = plain.time + np.where(plain.time > 10.0, 7.0, 0.0)
    notes = admit([Recording("run", time, plain.columns)], [], SOPRA).notes
    assert any("the clock jumps by 7.0" in note for note in notes)
