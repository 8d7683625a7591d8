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
from softarm.estimator.effects import describe
from softarm.estimator.specimen import load_specimen

PACKAGE = "softarm.estimator.diagnosis"
OF_THE_NOISE = ("evidence", "nominal")
OF_THE_CHOICE = (
    "choose", "candidates", "judge", "excursions", "probability", "screen", "law_error", "sizes", "unnamed",
    "conclude", "diagnose",
)  # fmt: skip
"""Modules whose constants decide: before anything is fitted, and after."""
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
def deciding_constants() -> tuple[DecidingConstant, ...]:
    """Read every number of the modules that decide, with its text; neighbours may share one."""
    found: list[DecidingConstant] = []
    for module in (*OF_THE_NOISE, *OF_THE_CHOICE):
        lines = ast.parse(inspect.getsource(importlib.import_module(f"{PACKAGE}.{module}"))).body
        named: list[tuple[str, float]] = []
        for line in lines:
            if isinstance(line, ast.Assign) and isinstance(line.value, ast.Constant):
                number, target = line.value.value, line.targets[0]
                if isinstance(target, ast.Name) and isinstance(number, int | float):
                    named.append((target.id, float(number)))
            elif isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and named:
                source = " ".join(str(line.value.value).split())
                found += [DecidingConstant(module, name, number, source) for name, number in named]
                named = []
        found += [DecidingConstant(module, name, number, "") for name, number in named]
    return tuple(found)


@cache
def _assigned(module: str) -> frozenset[str]:
    """List the names that a module gives a value of its own, at its top."""
    lines = ast.parse(inspect.getsource(importlib.import_module(module))).body
    targets = [target for line in lines if isinstance(line, ast.Assign) for target in line.targets]
    names = [node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]
    return frozenset(names)


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


def sensitivity_table(
    trials: Sequence[Trial],
    kept: Path,
    notify: Callable[[str], None],
    advance: Callable[[float], None] = lambda _: None,
) -> Table:
    """Move every deciding constant by a fifth either way, and list the verdicts that change.

    Args:
        trials: The fixed set.
        kept: Folder of products and verdicts, of one version of the program.
        notify: Called with the verdicts.
        advance: Called after each constant of each trial.
    """
    constants = deciding_constants()
    changes: dict[DecidingConstant, list[str]] = {one: [] for one in constants}
    for trial in trials:
        known = read_verdicts(kept, trial)
        evidence = products_of_trial(trial, kept)
        search = remembering(evidence)
        usual = verdict_of(_fresh(search))
        notify(f"{trial.name}: {', '.join(usual)}")
        for one in constants:
            for factor in (1.0 - STEP, 1.0 + STEP):
                key = f"{one.module}.{one.name} x {factor:g}"
                if key not in known:
                    with moved(one, factor):
                        again = one.module in OF_THE_NOISE or one.name in OF_THE_FITS
                        known[key] = verdict_of(remembering(evidence) if again else _fresh(search))
                    add_verdict(kept, trial, key, known[key])
                if known[key] != usual:
                    changes[one].append(f"{trial.name} x {factor:g}: {', '.join(known[key])}")
            advance(1.0)
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
    return Table(f"Deciding constants moved by a fifth on {len(trials)} trials", rows)


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
