"""Load a recording from any format that is read, save it in any that is written."""

from collections.abc import Mapping
from pathlib import Path

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.files import parse_toml, require_free, whole_files
from softarm.estimator.recording import Recording
from softarm.recordings.c3d import read_c3d
from softarm.recordings.info import format_info, read_info, sidecar
from softarm.recordings.mcap_reader import read_contents, read_mcap
from softarm.recordings.mcap_writer import INFO_FILE, write_recording
from softarm.recordings.qualisys import read_tsv
from softarm.recordings.validate import checked_recording

TABLES = (".csv", ".parquet")
WRITTEN = (*TABLES, ".mcap")
QUALISYS = (".c3d", ".tsv")
READ = (*WRITTEN, *QUALISYS)
STEM = "recording"


def load_recording(
    path: str | Path, column_map: str | Path | None = None, *, units_checked: bool = True
) -> Recording:
    """Load a recording.

    Args:
        path: A folder with ``recording.csv``, ``.parquet`` or ``.mcap``, or a file of those formats, ``.c3d``
            or ``.tsv``.
        column_map: For Qualisys exports, a TOML file whose tables ``markers`` and ``bodies`` map labels
            and rigid bodies to their names in a recording; the TOML beside the export when left out.
        units_checked: Whether values that only another unit explains are refused; off where an intake,
            which corrects them, follows.

    Raises:
        InputError: Names the file, the field and the cure.
    """
    path = data_file(Path(path))
    name = path.parent.name if path.stem == STEM and path.parent.name else path.stem
    suffix = path.suffix.lower()
    if is_mcap(path):
        return read_mcap(path, name.removesuffix(".mcap"), units_checked=units_checked)
    info = read_info(Path(column_map) if column_map else sidecar(path))
    source = str(path)
    columns: dict[str, Floats]
    if suffix in TABLES:
        from softarm.recordings.table import read_csv, read_parquet  # Polars, which a service never needs

        columns = read_csv(path) if suffix == ".csv" else read_parquet(path)
    elif suffix == ".c3d":
        columns = read_c3d(path, info)
    else:
        columns = read_tsv(path, info)
    info = {key: value for key, value in info.items() if key not in ("markers", "bodies")}
    return checked_recording(name, source, columns, info, units_checked=units_checked)


def output_file(path: str | Path, *, force: bool) -> Path:
    """Return the file that `save_recording` writes for a path, and refuse what it would refuse.

    Raises:
        InputError: The format is not one that is written, the path or the TOML of a table exists, or the
            folder cannot be written.
    """
    path = _data_file_to_write(Path(path))
    require_free(path, force=force)
    if path.suffix in TABLES:
        require_free(sidecar(path), force=force)
    return path


def _data_file_to_write(path: Path) -> Path:
    if path.is_dir() or not path.suffix:
        path = path / f"{STEM}.csv"
    if path.suffix not in WRITTEN:
        raise InputError(str(path), f"{path.suffix} is not written", f"end the path in {', '.join(WRITTEN)}")
    return path


def save_recording(
    recording: Recording,
    path: str | Path,
    *,
    force: bool = False,
    attachments: Mapping[str, bytes] | None = None,
) -> tuple[Path, ...]:
    """Save a recording whole: all of its files appear, or none.

    Args:
        recording: What to save.
        path: A file ``.csv``, ``.parquet`` (each with a ``.toml`` beside it) or ``.mcap``, or a folder, which
            gets ``recording.csv`` and ``recording.toml``.
        force: Replace what is there.
        attachments: More files to keep, in MCAP inside, else beside; such as ``specimen.toml``.

    Returns:
        The files written; a TOML file that holds the same already stays.

    Raises:
        InputError: The format is not one that is written, or one of the files exists.
    """
    path = _data_file_to_write(Path(path))
    require_free(path, force=force)
    if path.suffix == ".mcap":
        with whole_files(path) as (draft,), draft.open("wb") as file:
            write_recording(recording, file, attachments)
        return (path,)
    from softarm.recordings.table import write_csv, write_parquet

    contents = {sidecar(path): format_info(recording.info)}
    contents |= {path.parent / name: data for name, data in (attachments or {}).items()}
    contents = {sibling: data for sibling, data in contents.items() if not _holds(sibling, data)}
    for sibling in contents:
        require_free(sibling, force=force)
    with whole_files(*contents, path) as drafts:
        for draft, data in zip(drafts[:-1], contents.values(), strict=True):
            draft.write_bytes(data)
        write = write_csv if path.suffix == ".csv" else write_parquet
        write(recording, drafts[-1])
    return (path, *contents)


def _holds(file: Path, data: bytes) -> bool:
    """Return whether a TOML file holds the same as some bytes, perhaps in another layout."""
    try:
        return file.is_file() and parse_toml(str(file), file.read_bytes()) == parse_toml(str(file), data)
    except InputError:
        return False


def read_attachments(path: str | Path) -> dict[str, bytes]:
    """Read the files kept with a recording: inside MCAP, or the specimen beside a table.

    Returns:
        File name to content; empty where no file is kept.

    Raises:
        InputError: There is no such recording, or it cannot be read.
    """
    path = data_file(Path(path))
    if is_mcap(path):
        return {k: v for k, v in read_contents(path).attachments.items() if k != INFO_FILE}
    specimen = path.parent / "specimen.toml"
    return {specimen.name: specimen.read_bytes()} if specimen.is_file() else {}


def is_mcap(path: Path) -> bool:
    """Return whether a data file is MCAP, complete or still being written."""
    return path.name.lower().endswith((".mcap", ".mcap.part"))


def data_file(path: Path) -> Path:
    """Return the file that holds the data of a recording, which may be given as its folder.

    Raises:
        InputError: There is no such file, or of a format that is not read.
    """
    if path.is_dir():
        present = [path / f"{STEM}{suffix}" for suffix in WRITTEN if (path / f"{STEM}{suffix}").is_file()]
        if len(present) != 1:
            what = "holds several recordings" if present else f"holds no {STEM}.csv, .parquet or .mcap"
            raise InputError(str(path), what, "give the file itself")
        return present[0]
    if not path.is_file():
        raise InputError(str(path), "there is no such file or folder", "give the path of a recording")
    if path.suffix.lower() not in READ and not is_mcap(path):
        raise InputError(
            str(path),
            f"{path.suffix or 'a file without suffix'} is not read",
            f"give a folder or a file that ends in {', '.join(READ)}",
        )
    return path
