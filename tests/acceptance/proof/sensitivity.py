"""Which verdicts change when a constant of the choice moves by a fifth, on trials whose products are kept."""

import ast
import importlib
import inspect
import json
import pickle
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np

from softarm.analysis.diagnosis.run import DiagnosisRequest, run
from softarm.analysis.diagnosis.workers import Inline
from softarm.bench.trials.folders import Trial
from softarm.common.tables import Cell, Table
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.diagnose import Assembled, begin, decide
from softarm.estimator.diagnosis.evidence import RegressionProblem
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.valve_stage import splits_of, valve_findings
from softarm.estimator.effects import describe
from softarm.estimator.specimen import load_specimen
from softarm.recordings import load_recording

PACKAGE = "softarm.estimator.diagnosis"
OF_THE_NOISE = ("evidence", "nominal")
OF_THE_CHOICE = (
    "choose", "candidates", "judge", "excursions", "probability", "screen", "law_error", "sizes", "unnamed",
    "explanations", "confirm", "diagnose",
)  # fmt: skip
"""Modules whose constants decide: before anything is fitted, and after."""
OF_THE_VALVES = ("valves", "valve_stage")
"""Modules whose constants decide what is said of valves, by set-points and measured pressures alone."""
OF_THE_FITS = frozenset({"MOST_SURPRISE", "ALIKE", "EXACT_STEPS"})
"""Constants of the choice that change fits, so that none may be kept from other values."""
STEP = 0.2
VERDICTS = "verdicts.jsonl"
"""One JSON line per trial, constant and factor, beside the products; a run that was ended goes on from it."""

Verdict = tuple[str, ...]
"""A verdict, and each name with its place."""


@dataclass(frozen=True)
class DecidingConstant:
    """A number that decides.

    Args:
        module: Where it is.
        name: Its name.
        value: Its value.
        source: What the program says of it.
    """

    module: str
    name: str
    value: float
    source: str


@cache
def deciding_constants(
    modules: tuple[str, ...] = (*OF_THE_NOISE, *OF_THE_CHOICE),
) -> tuple[DecidingConstant, ...]:
    """Read every number of the modules that decide, with its text; neighbours may share one."""
    found: list[DecidingConstant] = []
    for name in modules:
        module = importlib.import_module(f"{PACKAGE}.{name}")
        numbers: list[tuple[str, float]] = []
        for line in ast.parse(inspect.getsource(module)).body:
            if isinstance(line, ast.Assign):
                values = [(one, getattr(module, one)) for one in _targets(line)]
                numbers += [(one, value) for one, value in values if isinstance(value, int | float)]
            elif isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and numbers:
                source = " ".join(str(line.value.value).split())
                found += [DecidingConstant(name, one, value, source) for one, value in numbers]
                numbers = []
        found += [DecidingConstant(name, one, value, "") for one, value in numbers]
    return tuple(found)


def _targets(line: ast.Assign) -> list[str]:
    """List the names to which a line gives values."""
    return [node.id for target in line.targets for node in ast.walk(target) if isinstance(node, ast.Name)]


@cache
def _assigned(module: str) -> frozenset[str]:
    """List the names that a module gives a value of its own, at its top."""
    lines = ast.parse(inspect.getsource(importlib.import_module(module))).body
    return frozenset(name for line in lines if isinstance(line, ast.Assign) for name in _targets(line))


@contextmanager
def moved(constant: DecidingConstant, factor: float) -> Iterator[None]:
    """Multiply a constant wherever it has been imported; whole numbers move by one at least."""
    old = getattr(importlib.import_module(f"{PACKAGE}.{constant.module}"), constant.name)
    value = constant.value * factor
    if isinstance(old, int):
        value = max(1, old + (1 if factor > 1.0 else -1) * max(1, round(STEP * old)))
    own = f"{PACKAGE}.{constant.module}"
    holders = [
        module
        for name, module in list(sys.modules.items())
        if name.startswith(PACKAGE)
        and getattr(module, constant.name, None) is old
        and (name == own or constant.name not in _assigned(name))
    ]
    try:
        for module in holders:
            setattr(module, constant.name, value)
        yield
    finally:
        for module in holders:
            setattr(module, constant.name, old)


@dataclass(frozen=True)
class RememberingSearch(Search):
    """A search that fits nothing twice."""

    joint: dict[object, Fit] = field(default_factory=dict, compare=False)

    def refit(self, fit: Fit) -> Fit:
        """Fit all accepted effects together, once; see ``Search``."""
        key = (*((h.name, str(h.place)) for h in fit.hypotheses), *(tuple(t) for t in fit.thetas))
        if key not in self.joint:
            self.joint[key] = super().refit(fit)
        return self.joint[key]


def products_of_trial(trial: Trial, kept: Path) -> RegressionProblem:
    """Return the residuals and columns of a trial, from those kept if they are."""
    file = kept / f"{trial.name}.pickle"
    if not file.exists():
        request = DiagnosisRequest(trial.questioned, trial.nominal, load_specimen(trial.specimen))
        box: list[Assembled] = []
        run(request, Inline(), keep=box.append)
        kept.mkdir(parents=True, exist_ok=True)
        file.write_bytes(pickle.dumps(box[-1].evidence, protocol=5))
    found: RegressionProblem = pickle.loads(file.read_bytes())  # written by this command
    return found


def verdict_of(search: Search) -> Verdict:
    """Decide anew, and list the verdict with the names and their places."""
    decision = decide(search)
    fit = decision.choice.fit
    hypotheses = () if fit is None else fit.hypotheses
    names = sorted(f"{h.name} ({describe(h.place)})" for h in hypotheses)
    return decision.verdict(explained=bool(names)), *names


def remembering(evidence: RegressionProblem) -> RememberingSearch:
    """Begin a search that remembers its fits."""
    plain = begin(evidence, fast=True)
    return RememberingSearch(**{name: getattr(plain, name) for name in plain.__dataclass_fields__})


Verdicts = Callable[[DecidingConstant | None], Verdict]
"""Gives the verdict on a trial as constants are; its argument is the one that has been moved."""


def of_choice(trial: Trial, kept: Path) -> Verdicts:
    """Prepare verdicts on what the arm does.

    Args:
        trial: The trial.
        kept: Folder of products.
    """
    evidence = products_of_trial(trial, kept)
    search = remembering(evidence)

    def verdict(one: DecidingConstant | None) -> Verdict:
        again = one is not None and (one.module in OF_THE_NOISE or one.name in OF_THE_FITS)
        return verdict_of(remembering(evidence) if again else _fresh(search))

    return verdict


def of_valves(trial: Trial, kept: Path) -> Verdicts:  # noqa: ARG001
    """Prepare verdicts on what the valves do."""
    suspects, nominal = (
        [load_recording(path) for path in paths] for paths in (trial.questioned, trial.nominal)
    )

    def verdict(one: DecidingConstant | None) -> Verdict:  # noqa: ARG001
        found = valve_findings(splits_of(suspects), splits_of(nominal))
        return tuple(f"{finding.effect} ({describe(finding.where)})" for finding in found)

    return verdict


@dataclass(frozen=True)
class Decided:
    """What is decided by constants.

    Args:
        title: Of the table.
        modules: Where they are.
        prepare: Prepares verdicts on a trial, with the folder of products.
    """

    title: str
    modules: tuple[str, ...]
    prepare: Callable[[Trial, Path], Verdicts]


CHOICE = Decided("Deciding constants", (*OF_THE_NOISE, *OF_THE_CHOICE), of_choice)
VALVES = Decided("Deciding constants of valves", OF_THE_VALVES, of_valves)


def sensitivity_table(
    decided: Decided, trials: Sequence[Trial], kept: Path, notify: Callable[[str], None]
) -> Table:
    """Move every deciding constant by a fifth either way, and list the verdicts that change.

    Args:
        decided: What is decided.
        trials: The fixed set.
        kept: Folder of products and verdicts, of one version of the program.
        notify: Called with the verdicts.
    """
    constants = deciding_constants(decided.modules)
    changes: dict[DecidingConstant, list[str]] = {one: [] for one in constants}
    for trial in trials:
        known, verdict = read_verdicts(kept, trial), decided.prepare(trial, kept)
        usual = verdict(None)
        notify(f"{trial.name}: {', '.join(usual) or 'nothing'}")
        for one in constants:
            for factor in (1.0 - STEP, 1.0 + STEP):
                key = f"{one.module}.{one.name} x {factor:g}"
                if key not in known:
                    with moved(one, factor):
                        known[key] = verdict(one)
                    add_verdict(kept, trial, key, known[key])
                if known[key] != usual:
                    said = ", ".join(known[key]) or "nothing"
                    changes[one].append(f"{trial.name} x {factor:g}: {said}")
    rows: list[dict[str, Cell]] = [
        {
            "constant": f"{one.module}.{one.name}",
            "value": one.value,
            "source": one.source or "-",
            "changes": len(changes[one]),
            "which": "; ".join(changes[one]) or None,
        }
        for one in constants
    ]
    return Table(f"{decided.title} moved by a fifth on {len(trials)} trials", rows)


def read_verdicts(kept: Path, trial: Trial) -> dict[str, Verdict]:
    """Read the verdicts on a trial of earlier runs, by constant and factor."""
    file = kept / VERDICTS
    lines = file.read_text().rpartition("\n")[0].splitlines() if file.exists() else []
    return {key: tuple(verdict) for name, key, verdict in map(json.loads, lines) if name == trial.name}


def add_verdict(kept: Path, trial: Trial, key: str, verdict: Verdict) -> None:
    """Keep a verdict."""
    kept.mkdir(parents=True, exist_ok=True)
    with (kept / VERDICTS).open("a") as file:
        file.write(json.dumps([trial.name, key, verdict]) + "\n")


def _fresh(search: RememberingSearch) -> RememberingSearch:
    """Take the same search with the same random numbers and all that it has fitted, but no prediction."""
    return replace(search, rng=np.random.default_rng(0), predictions={})
