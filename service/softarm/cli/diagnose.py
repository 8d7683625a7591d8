"""``softarm diagnose RECORDING... --specimen S``: the physics that a model leaves out."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import click

from softarm.cli.output import (
    PATH,
    folder_option,
    force_option,
    json_option,
    notify,
    progress,
    recordings_argument,
    specimen_option,
)

NOMINAL = "--nominal"


SHARES = {
    "reading": 3.0,
    "preparing the model": 2.0,
    "fitting the rod": 60.0,
    "calibrating": 20.0,
    "predicting": 15.0,
    "trying effects": 25.0,
    "fitting": 25.0,
    "judging": 10.0,
}
"""Share of the time that each part of a diagnosis takes, in their order; a stored rod is not fitted."""


class _Steps:
    """Converts the name of the present part to progress: a part counts as done when a later one begins."""

    def __init__(self, advance: Callable[[float], None]) -> None:
        self._advance = advance
        self._done = 0.0

    def advance(self, what: str) -> None:
        """Note what is being done, such as ``fitting`` or ``fitting the rod, 3 of 16``."""
        part, _, count = what.partition(", ")
        if part not in SHARES:
            return
        names = list(SHARES)
        done = sum(SHARES[name] for name in names[: names.index(part)])
        if count:
            step, _, steps = count.partition(" of ")
            done += SHARES[part] * float(step) / float(steps)
        self._advance(max(done - self._done, 0.0))
        self._done = max(done, self._done)


class NominalCommand(click.Command):
    """A command whose ``--nominal`` accepts every word up to the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Write ``--nominal A B`` as ``--nominal A --nominal B``.

        Raises:
            click.UsageError: No word follows.
        """
        written: list[str] = []
        taking = False
        for word, following in pairwise([*args, "-"]):
            if word == NOMINAL:
                if following.startswith("-"):
                    raise click.UsageError(f"Option '{NOMINAL}' needs at least one recording.", ctx)
                taking = True
                continue
            taking = taking and not word.startswith("-")
            written += [NOMINAL, word] if taking else [word]
        return super().parse_args(ctx, written)


@click.command(cls=NominalCommand)
@recordings_argument
@specimen_option
@click.option(
    NOMINAL,
    multiple=True,
    type=PATH,
    metavar="RECORDING...",
    help="Recordings of the arm in its known state; only differences from them are reported.",
)
@folder_option("Folder for report.json, report.html and what softarm page --diagnosis shows.")
@click.option(
    "--write-specimen",
    type=PATH,
    metavar="S2",
    help="Specimen file to write, with the accepted effects as physics of the model.",
)
@click.option(
    "--effect", "effects", multiple=True, metavar="NAME", help="Try only this effect; may be repeated."
)
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the random numbers."
)
@click.option(
    "--jobs", "-j", type=click.IntRange(1), default=2, show_default=True, help="Number of processes."
)
@click.option("--dask", metavar="ADDRESS", help="Run on the Dask cluster at this address instead.")
@force_option
@json_option
def command(
    recordings: tuple[Path, ...],
    specimen: str | None,
    nominal: tuple[Path, ...],
    out: Path | None,
    write_specimen: Path | None,
    effects: tuple[str, ...],
    seed: int,
    jobs: int,
    dask: str | None,
    force: bool,
    as_json: bool,
) -> int:
    """Find where model and recordings differ, and which physics the model leaves out.

    The command calibrates the model, locates the mismatch, tries every known effect at every place, and
    accepts the effects that improve the prediction of held-out data. If the recordings cannot distinguish two
    effects, both are named, with the manoeuvre that would separate them. A mismatch that no effect explains
    is called unknown. If --out already holds the diagnosis of the same recordings, and the
    specimen that it wrote is still there, it is not repeated.

    Example: softarm diagnose run1 run2 --nominal known1 --specimen sopra --out report
    """
    from softarm.analysis.diagnosis.digest import (
        digest_of,
        report_up_to_date,
        require_free_folder,
        specimen_up_to_date,
        write_digest,
        write_report,
    )
    from softarm.analysis.diagnosis.html import FILE as HTML
    from softarm.analysis.diagnosis.html import write_html
    from softarm.analysis.diagnosis.motion import write_motions
    from softarm.analysis.diagnosis.report import report_of
    from softarm.analysis.diagnosis.run import DiagnosisRequest, effects_outside_model, improved_specimen, run
    from softarm.analysis.diagnosis.sentences import summary
    from softarm.analysis.diagnosis.workers import workers
    from softarm.analysis.offline.inputs import specimen_of_any
    from softarm.estimator.specimen import require_free_specimen, save_specimen

    robot = specimen_of_any(specimen, recordings)
    request = DiagnosisRequest(recordings, nominal, robot, seed, effects)
    digest = digest_of(request)
    earlier = report_up_to_date(out, digest) if out is not None and not force else None
    if (
        out is not None
        and earlier is not None
        and (write_specimen is None or specimen_up_to_date(out, write_specimen))
    ):
        notify(f"{out} holds this diagnosis already; --force repeats it")
        words = f"{earlier.specimen}: {earlier.verdict.replace('_', ' ')}.\nReport: {out / HTML}"
        click.echo(earlier.dump() if as_json else words, nl=not as_json)
        return 0
    if out is not None:
        require_free_folder(out, request, force=force)
    if write_specimen is not None:
        require_free_specimen(write_specimen, force=force)
    assumed: list[str] = []
    with workers(jobs, dask) as executor, progress("diagnosing", sum(SHARES.values())) as advance:
        outcome = run(request, executor, _Steps(advance).advance, notify=assumed.append)
    for line in assumed:
        notify(line)
    report = report_of(outcome.diagnosis)
    if out is not None:
        notify(f"wrote {write_report(report, out)}")
        notify(f"wrote {write_html(outcome.diagnosis, robot, out)}")
        notify(f"wrote {write_motions(outcome.diagnosis, robot, out)}")
    if write_specimen is not None:
        save_specimen(improved_specimen(robot, outcome), write_specimen)
        notify(f"wrote {write_specimen}{_without(effects_outside_model(outcome))}")
    if out is not None:
        write_digest(digest, out, write_specimen)
    if as_json:
        click.echo(report.dump(), nl=False)
    else:
        for line in summary(outcome.diagnosis):
            click.echo(line)
        where = f"Report: {out / HTML}" if out is not None else "Add --out FOLDER to write the whole report."
        click.echo(where)
    return 0


def _without(effects: tuple[str, ...]) -> str:
    """State which effects a written specimen does not contain, and why."""
    if not effects:
        return ""
    return f" without {', '.join(effects)}: only what was fitted to the motion is physics of the model"
