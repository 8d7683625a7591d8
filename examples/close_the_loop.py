"""From a mismatch to a better estimate on simulated instruments.

An effect that the model lacks is switched on in the fake arm. The service attributes it to a force and
reports that model and measurements disagree. Recordings from before and after the change are diagnosed. A
second service runs on the specimen that the diagnosis wrote; the same motion no longer looks like a force.

Run it with: python examples/close_the_loop.py --out out/loop
"""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import click
import numpy as np

from softarm.analysis.diagnosis.report import Report, read_report
from softarm.cli.output import notify, show
from softarm.common.shipped import DEMO_SCENARIO, fake_specimen
from softarm.common.tables import Table
from softarm.estimator.excitation import ChosenManoeuvre, Manoeuvre
from softarm.experiments.excitation import Recorded, run_excitation, run_manoeuvre, specimen_of_arm
from softarm.experiments.excitation_plan import manoeuvres_of
from softarm.experiments.rig import FakeRig, RigSettings
from softarm.experiments.rig_control import FakeControl
from softarm.experiments.session import connect, wait_ready
from softarm_client import Arm
from softarm_client.errors import CommandRefusedError
from softarm_client.messages import Estimate, Mismatch, State

CHAMBER = 0
EFFECT: dict[str, Any] = {"where": {"chamber": CHAMBER}, "change": -0.25}
"""What is concealed: a chamber that lost a quarter of its gain."""
SUSPECT = ("each_alone",)
WATCHED = "poses"
SPECIMEN = "improved.toml"

Result = TypeVar("Result")


@dataclass
class Watch:
    """Collects what the service publishes while the arm moves, free of any force.

    Args:
        forces: Norm of the sum of all estimated forces [N], while the changed chamber is to hold pressure:
            only then can its gain look like a force.
        innovations: Running mean of the innovation squared, per degree of freedom.
        inconsistent: How many messages called model and measurements inconsistent.
    """

    forces: list[float] = field(default_factory=list)
    innovations: list[float] = field(default_factory=list)
    inconsistent: int = 0
    asked_pa: float = 0.0

    def add_state(self, state: State) -> None:
        """Note the set-point of the chamber that changes."""
        self.asked_pa = state.asked_pa[CHAMBER]

    def add_estimate(self, estimate: Estimate) -> None:
        """Add the force of an estimate that is of use."""
        if self.asked_pa > 0.0 and estimate.status in ("converged", "degraded"):
            force = np.sum([load.force_n for load in estimate.loads], axis=0)
            self.forces.append(float(np.linalg.norm(force)))

    def add_mismatch(self, mismatch: Mismatch) -> None:
        """Add the innovation of a test of the model, and whether it was passed."""
        if mismatch.normalised_innovation_squared is not None:
            self.innovations.append(mismatch.normalised_innovation_squared)
            self.inconsistent += not mismatch.consistent

    def row(self, specimen: str) -> dict[str, str | float]:
        """Return the row of the table; medians, since a live estimate may be lost in a fast transient."""
        share = self.inconsistent / len(self.innovations) if self.innovations else float("nan")
        return {
            "specimen": specimen,
            "apparent_force_n": _median(self.forces),
            "innovation_squared": _median(self.innovations),
            "inconsistent_percent": 100.0 * share,
        }


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else float("nan")


def watch(client: Arm, manoeuvre: Manoeuvre) -> tuple[Watch, Recorded]:
    """Run and record a manoeuvre, and watch the estimates meanwhile."""
    seen = Watch()
    client.arm()
    with (
        client.states().subscribe(seen.add_state),
        client.estimates().subscribe(seen.add_estimate),
        client.mismatches().subscribe(seen.add_mismatch),
    ):
        run = run_manoeuvre(client, manoeuvre, lambda _: None)
    client.disarm()
    return seen, run


def diagnose(suspect: Sequence[Recorded], nominal: Sequence[Recorded], specimen: str, out: Path) -> Report:
    """Run ``softarm diagnose`` and let it write the improved specimen."""
    words = ["diagnose", *(run.path for run in suspect), "--specimen", specimen, "--out", str(out)]
    for run in nominal:
        words += ["--nominal", run.path]
    words += ["--write-specimen", str(out / SPECIMEN)]
    subprocess.run([sys.executable, "-m", "softarm", *words], check=True)
    return read_report(out)


def close_the_loop(specimen: str, out: Path, endpoint: str) -> tuple[Report, list[Watch]]:
    """Run the whole loop; return the report, and what was seen before the change, after it and at the end."""
    settings = RigSettings(DEMO_SCENARIO, specimen=specimen, endpoint=endpoint, sensors=("pose",))
    with FakeRig(settings, out / "before") as rig, connect(rig) as client:
        wait_ready(client)
        manoeuvres = {m.name: m for m in manoeuvres_of(specimen_of_arm(client))}
        notify("recording the unchanged arm")
        with FakeControl(str(rig.announcement["control"])) as fakes, client.lease():
            built, nominal = watch(client, manoeuvres[WATCHED])
            fakes.ask("switch", effect="chamber_gain", value=EFFECT)
            notify("recording the changed arm")
            suspect = _record(client, manoeuvres, SUSPECT)
            before, watched = watch(client, manoeuvres[WATCHED])
    notify("diagnosing")
    report = diagnose([*suspect, watched], [nominal], specimen, out / "diagnosis")
    improved = RigSettings(
        DEMO_SCENARIO, specimen=str(out / "diagnosis" / SPECIMEN), endpoint=endpoint, sensors=("pose",)
    )
    with FakeRig(improved, out / "after") as rig, connect(rig) as client:
        wait_ready(client)
        with FakeControl(str(rig.announcement["control"])) as fakes, client.lease():
            fakes.ask("switch", effect="chamber_gain", value=EFFECT)
            notify("running the changed arm with the improved specimen")
            after, _ = watch(client, manoeuvres[WATCHED])
    return report, [built, before, after]


def _record(client: Arm, manoeuvres: dict[str, Manoeuvre], names: Sequence[str]) -> list[Recorded]:
    choices = [ChosenManoeuvre(manoeuvres[name]) for name in names]
    return run_excitation(client, choices, lambda _: False, lambda _: None)


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/loop"), show_default=True)
@click.option("--specimen", help="Specimen of the arm before; that of the fake arm when left out.")
@click.option("--endpoint", default="tcp/127.0.0.1:7448", show_default=True, help="zenoh endpoint to use.")
def main(out: Path, specimen: str | None, endpoint: str) -> None:
    """Diagnose a change of the fake arm, and print the findings and how much they improve the estimate."""
    try:
        report, watched = close_the_loop(specimen or str(fake_specimen()), out, endpoint)
    except CommandRefusedError as refusal:
        raise click.ClickException(f"{refusal}; run it again on a less busy machine") from refusal
    for finding in report.findings:
        notify(finding.statement)
    _, changed, after = watched
    ratio = _median(after.forces) / _median(changed.forces)
    notes = (
        f"Concealed: chamber {CHAMBER} lost {-100 * EFFECT['change']:.0f} %. No force acted on the arm: "
        f"the force before the change is an error of the model. Medians while chamber {CHAMBER} is filled.",
        f"Ratio of the apparent force with the findings to that after the change: {ratio:.3g}. "
        f"Verdict: {report.verdict}.",
    )
    names = ("before the change", "after the change", "with the findings")
    rows = [seen.row(name) for seen, name in zip(watched, names, strict=True)]
    show(Table("Apparent force before and after the diagnosis", rows, notes), as_json=False)


if __name__ == "__main__":
    main()
