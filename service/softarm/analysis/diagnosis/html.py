"""``report.html``: a diagnosis for people, in one file that fetches nothing."""

from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from softarm.analysis.diagnosis import sentences
from softarm.analysis.diagnosis.figures import draw_arm, draw_exposure, draw_trace
from softarm.estimator.diagnosis.detection import by_effect
from softarm.estimator.diagnosis.result import Cell, Diagnosis, LocationMap
from softarm.estimator.effects.effect import describe
from softarm.estimator.files import write_whole
from softarm.estimator.specimen import Specimen

FILE = "report.html"
TEMPLATE = "report.html.jinja"
CELLS = 10
REJECTED = 8
"""Rows of the map, and alternatives of a finding, that are shown."""


def write_html(diagnosis: Diagnosis, specimen: Specimen, folder: Path) -> Path:
    """Write ``report.html`` to a folder; an earlier one is replaced.

    Args:
        diagnosis: The result.
        specimen: The arm, for its drawing.
        folder: Made when absent.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_whole({folder / FILE: page(diagnosis, specimen).encode()})
    return folder / FILE


def page(diagnosis: Diagnosis, specimen: Specimen) -> str:
    """Return the text of the page; all that comes from recordings and specimens is escaped."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(TEMPLATE).render(
        diagnosis=diagnosis,
        words=sentences,
        describe=describe,
        exposures=[draw_exposure(f.exposure) if f.exposure else None for f in diagnosis.findings],
        arm=draw_arm(specimen, diagnosis.map.by_place()),
        cells=_cells(diagnosis.map)[:CELLS],
        rejected=REJECTED,
        traces=[(trace, draw_trace(trace)) for trace in diagnosis.traces if len(trace.time)],
        channels=_channels(diagnosis),
        limits=by_effect(diagnosis.detection_limits),
        pneumatic=bool(specimen.chambers),
    )


def _cells(found: LocationMap) -> list[Cell]:
    """Return the largest cell of each place and axis; recordings often cannot separate its regimes."""
    largest: dict[tuple[str, str, str], Cell] = {}
    for cell in found.cells:
        largest.setdefault((cell.kind, cell.name, cell.axis), cell)
    return list(largest.values())


def _channels(diagnosis: Diagnosis) -> list[list[str]]:
    """Return the rows of the table of channels."""
    base, heldout = diagnosis.baseline, diagnosis.heldout
    rows = []
    for channel, rms in base.rms.items():
        unit = base.units.get(channel, "")
        error = heldout.channels.get(channel)
        test = heldout.innovations
        rows.append(
            [
                channel,
                sentences.amount(rms, unit),
                sentences.amount(error.before, unit) if error else "-",
                sentences.amount(error.after, unit) if error else "-",
                sentences.amount(error.line, unit) if error and error.line is not None else "-",
                sentences.amount(base.noise_floor.get(channel, np.nan), unit),
                sentences.number(test.variance[channel]) if channel in test.variance else "-",
                f"{test.correlation[channel]:.2f}" if channel in test.correlation else "-",
            ]
        )
    return rows
