"""Planning an excitation: from a diagnosis that leaves rivals to the manoeuvres that split them."""

from collections.abc import Callable, Sequence

import numpy as np

from softarm.analysis.diagnosis.report import FindingPart, Report
from softarm.common.rods import known_rod, rod_for
from softarm.estimator.arm import build_arm
from softarm.estimator.effects import EFFECTS, Spot, World
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.errors import InputError
from softarm.estimator.excitation import (
    EffectPair,
    ExcitationPlan,
    Manoeuvre,
    ManoeuvreLimits,
    SeparatedArm,
    full_plan,
    plan_for,
    standard_manoeuvres,
)
from softarm.estimator.model import Frames
from softarm.estimator.response import BatchArmModel, BatchInputs
from softarm.estimator.sensing import Registration, SensorSuite
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.sequential_batch import SequentialBatchModel
from softarm.estimator.simulation import Segments, SimulatedArm, section_loads
from softarm.estimator.specimen import Specimen
from softarm.estimator.specimen.physics import Place

DEFAULT_SLEW = 200e3
KINDS = ("bend", "orientation", "frame")
"""Kinds of sensors by the first word of their names."""


def manoeuvres_of(
    specimen: Specimen,
    names: Sequence[str] = (),
    *,
    by_hand: bool = False,
    slew: float = DEFAULT_SLEW,
    share: float = 0.75,
) -> tuple[Manoeuvre, ...]:
    """List the manoeuvres that a specimen can do.

    Args:
        specimen: The arm.
        names: Which ones; all when empty.
        by_hand: Whether somebody is there to rotate the mount and to pluck the arm.
        slew: Fastest change of a set-point [Pa/s].
        share: Part of the largest pressures to use.

    Raises:
        InputError: A name is unknown.
    """
    limits = ManoeuvreLimits(np.array(specimen.pressure_limits), slew, share)
    order = [part.name for part in specimen.segments]
    every = standard_manoeuvres(tuple(order.index(chamber.segment) for chamber in specimen.chambers), limits)
    by_name = {manoeuvre.name: manoeuvre for manoeuvre in every}
    for name in names:
        if name not in by_name:
            raise InputError(f"--manoeuvre {name}", "is unknown", f"choose from: {', '.join(by_name)}")
    if names:
        return tuple(manoeuvre for manoeuvre in every if manoeuvre.name in names)
    return tuple(manoeuvre for manoeuvre in every if by_hand or not manoeuvre.by_hand)


def make_plan(
    specimen: Specimen,
    manoeuvres: Sequence[Manoeuvre],
    report: Report | None,
    advance: Callable[[float], None] = lambda _: None,
) -> ExcitationPlan:
    """Plan the manoeuvres that split a report's rivals, or all of them where nothing is in doubt.

    Args:
        specimen: The arm.
        manoeuvres: What may be run.
        report: What was diagnosed so far.
        advance: Called with 1 after each pair on each manoeuvre.

    Raises:
        InputError: The report is of another specimen.
    """
    if report is None or not any(finding.confusable_with for finding in report.findings):
        return full_plan(manoeuvres)
    if report.specimen != specimen.name:
        what = f"is of the specimen {report.specimen!r}, not {specimen.name!r}"
        raise InputError("--report", what, "give the specimen that was diagnosed")
    subject = subject_of(specimen, _sensor_names(report))
    pairs = [
        EffectPair(_found(subject.world, finding), _typical(subject.world, rival.effect, rival.where))
        for finding in report.findings
        if finding.effect in EFFECTS
        for rival in finding.confusable_with
        if rival.effect in EFFECTS
    ]
    return plan_for(pairs, manoeuvres, subject, advance) if pairs else full_plan(manoeuvres)


def count_of_pairs(report: Report | None) -> int:
    """Count the pairs of rivals that a report leaves."""
    return 0 if report is None else sum(len(finding.confusable_with) for finding in report.findings)


def subject_of(specimen: Specimen, sensors: Sequence[str] = ()) -> SeparatedArm:
    """Build the model on which rivals are tried.

    Args:
        specimen: The arm.
        sensors: Names of its sensors, such as ``bend_tip``; orientations of all sections when empty.
    """
    arm = _arm(specimen)
    sections, segments = arm.model.sections, arm.segments
    names = tuple(sensors) or tuple(f"orientation_{name}" for name in sections)
    made = SpecimenSensors(specimen, sections, Registration())
    suite = SensorSuite(tuple(map(made.named, names)))
    world = World.of(specimen, segments, sections, arm.stiffness(), names)
    return SeparatedArm(arm, segments, world, suite, np.array(specimen.gravity_m_s2))


def _arm(specimen: Specimen) -> SimulatedArm:
    """Build the model: the calibrated rod where one is at hand, else the slower finite elements."""
    model: BatchArmModel
    if known_rod(specimen) is not None:
        rod = rod_for(specimen)
        model = rod.with_loads(section_loads(rod.sections))
    else:
        sections = tuple(section.name for section in specimen.sections)
        model = SequentialBatchModel(build_arm(specimen, section_loads(sections)))
    rest = model.evaluate(BatchInputs.none(model)).frames
    frames = Frames(rest.positions[0], rest.rotations[0])
    return SimulatedArm(model, Segments.of(specimen, model.sections, frames))


def _sensor_names(report: Report) -> tuple[str, ...]:
    """Return the sensors behind a report's channels, such as ``bend_tip`` of ``bend_tip.x``."""
    names = dict.fromkeys(channel.partition(".")[0] for channel in report.baseline.rms)
    return tuple(name for name in names if name.partition("_")[0] in KINDS)


def _found(world: World, finding: FindingPart) -> PlacedEffect:
    """Place a finding with its fitted parameters, and typical ones where the report has none."""
    effect = EFFECTS[finding.effect]
    parameters = finding.parameters
    theta = [parameters[p.name].value if p.name in parameters else p.typical for p in effect.parameters]
    return PlacedEffect(effect, Spot(world, finding.where), np.array(theta))


def _typical(world: World, name: str, where: Place) -> PlacedEffect:
    effect = EFFECTS[name]
    return PlacedEffect(effect, Spot(world, where), effect.typical)
