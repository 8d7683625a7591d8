"""Folders of blind trials and of their answers.

``TRIALS/<name>/trial.toml`` names the specimen; ``nominal/<run>/`` and ``questioned/<run>/`` hold recordings.
``ANSWERS/<name>.toml`` lists what was concealed. Only the scorer opens the answers.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from softarm.estimator.errors import InputError, suggest
from softarm.estimator.files import read_toml
from softarm.estimator.specimen import SHIPPED
from softarm.estimator.specimen.problems import describe_errors

TRIAL_FILE = "trial.toml"
LAYOUT = "see docs/diagnosis-proof.md for the layout"
COUNTS = {"single": 1, "pair": 2, "null": 0}
"""Number of effects that a trial of some kind conceals."""
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]


@dataclass(frozen=True)
class Trial:
    """One blind trial.

    Args:
        name: Of its folder.
        specimen: Name or path of the specimen for the diagnosis.
        nominal: Recordings of the arm in its known state; may be empty.
        questioned: Recordings in question.
    """

    name: str
    specimen: str
    nominal: tuple[Path, ...]
    questioned: tuple[Path, ...]


class Concealment(BaseModel):
    """One concealed effect.

    Args:
        effect: Its name.
        where: Where it acts: segment, chamber, section, sensor.
        size: Its parameters by name, in SI units.
    """

    model_config = ConfigDict(frozen=True)
    effect: str = Field(description="the name of the effect")
    where: Mapping[str, str | int] = {}
    size: Mapping[str, Number] = {}


class Answer(BaseModel):
    """What was concealed in a trial.

    Args:
        kind: ``single``, ``pair``, ``null`` or ``foreign``.
        concealed: The effects.
        motion: Kind of motion that was recorded, such as ``designed`` or ``ordinary``; may be empty.
    """

    model_config = ConfigDict(frozen=True)
    kind: Literal["single", "pair", "null", "foreign"] = Field(description="single, pair, null or foreign")
    concealed: tuple[Concealment, ...] = ()
    motion: str = ""


def read_trials(folder: Path) -> tuple[Trial, ...]:
    """Read every trial of a folder, in the order of their names.

    Raises:
        InputError: There is none, or one of them is not complete.
    """
    if not folder.is_dir():
        raise InputError(str(folder), "is not a folder", "give the folder that holds one folder per trial")
    trials = tuple(read_trial(path.parent) for path in sorted(folder.glob(f"*/{TRIAL_FILE}")))
    if not trials:
        raise InputError(str(folder), f"holds no trial: no */{TRIAL_FILE}", "see docs/diagnosis-proof.md")
    return trials


def read_trial(folder: Path) -> Trial:
    """Read one trial.

    Raises:
        InputError: It is not complete.
    """
    table, _ = read_toml(folder / TRIAL_FILE, LAYOUT)
    specimen = table.get("specimen")
    if not isinstance(specimen, str):
        raise InputError(str(folder / TRIAL_FILE), "names no specimen", 'add specimen = "..."')
    local = folder / specimen
    if not local.is_file() and specimen not in SHIPPED:
        what = f"there is no {specimen!r} in this folder, and no such shipped specimen"
        cure = suggest(specimen, SHIPPED, f"put it there, or name one of {', '.join(SHIPPED)}", cutoff=0.6)
        raise InputError(f"{folder / TRIAL_FILE}, specimen", what, cure)
    questioned = _recordings(folder / "questioned")
    if not questioned:
        raise InputError(str(folder), "has no recording in question", "put recordings into questioned/")
    return Trial(
        folder.name,
        str(local) if local.is_file() else specimen,
        _recordings(folder / "nominal"),
        questioned,
    )


def _recordings(folder: Path) -> tuple[Path, ...]:
    return (
        tuple(sorted(path for path in folder.iterdir() if not path.name.startswith(".")))
        if folder.is_dir()
        else ()
    )


def read_answer(folder: Path, trial: str) -> Answer:
    """Read the answer of a trial.

    Raises:
        InputError: It is missing, incomplete or malformed; names the file and its fields.
    """
    path = folder / f"{trial}.toml"
    table, _ = read_toml(path, LAYOUT)
    try:
        answer = Answer.model_validate(table)
    except ValidationError as error:
        raise describe_errors(str(path), error, Answer) from None
    count = COUNTS.get(answer.kind, len(answer.concealed))
    if len(answer.concealed) != count:
        raise InputError(
            f"{path}: concealed",
            f"a trial of kind {answer.kind} conceals {count} effects, {len(answer.concealed)} are listed",
            "correct the kind, or give each effect a table [[concealed]]",
        )
    return answer
