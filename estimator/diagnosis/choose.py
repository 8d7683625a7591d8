"""Which physics to accept: one effect at a time, judged by what it predicts where it was not fitted."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis.belief import Belief, Marginal
from estimator.diagnosis.evidence import Evidence
from estimator.diagnosis.fit import Fit, Ground, View, fit_effects, gain_of
from estimator.diagnosis.gram import Products, total, with_column
from estimator.diagnosis.judge import CERTAIN, Judgement, judge
from estimator.diagnosis.library import Direction, Hypothesis
from estimator.diagnosis.ring import Ring
from estimator.diagnosis.stage import ANSWERING, Stage
from estimator.diagnosis.weights import Weights
from estimator.effects import Parameter

Floats = NDArray[np.float64]

MOST = 4
"""Largest number of effects."""
FINALISTS = 10
"""Hypotheses that are fitted in each round."""
TRIED = 4
"""Best of them that may be accepted."""
LEAST_BIC = 10.0
SECOND = 0.5
"""Share of an accepted effect's gain that decides for another one so."""
HEAVY = ("tip_payload", "distributed_mass")
ALIKE = 4.0
ALIKE_SHARE = 0.01
"""Difference in the criterion, or its share of the best, within which the plainer of two is taken."""
MOST_SURPRISE = 12.0
"""Largest cost of a size that nobody expects."""
CLOSE = 0.8
"""Share of the best gain in the criterion below which a hypothesis is no candidate."""
MOVING = 0.5
"""The same for one at rest against one that only shows in motion."""
DRAWS = 400
INVISIBLE = 1e-3
"""Gain in cost of a typical effect below which it leaves no trace at all."""
TOLD = 3.0
"""Size of an amplitude over its standard deviation from which it is told from none."""
EXACT_STEPS = 3
"""Steps of a fit on the model itself, and the best finalists that are fitted so."""
RESOLVED = 4
WORTH = 0.25
"""Share of the best gain in the criterion from which that is done."""
TIED = 0.97
"""Share of the gain from which a rival is as good."""


@dataclass(frozen=True)
class Candidate:
    """A hypothesis after its fit.

    Args:
        number: Its number in the library.
        fit: The fit, together with the effects accepted before.
        gain: By how much it lowers the cost.
        delta_bic: The same less the price of its parameters and of a size that nobody expects.
    """

    number: int
    fit: Fit
    gain: float
    delta_bic: float


@dataclass(frozen=True)
class Accepted:
    """An accepted effect with its rivals.

    Args:
        candidate: The effect as it was chosen.
        judgement: What spoke for it.
        field: All finalists of its round, the best first.
    """

    candidate: Candidate
    judgement: Judgement
    field: tuple[Candidate, ...]


@dataclass(frozen=True)
class Choice:
    """The end of the search.

    Args:
        accepted: What was accepted, in the order of acceptance.
        fit: Joint fit of all; ``None`` where nothing was accepted.
        alarm_p: Chance of the best hypothesis' gain where nothing is missing.
        turned_down: The best candidate of the last round and why it failed, where there was one.
    """

    accepted: tuple[Accepted, ...]
    fit: Fit | None
    alarm_p: float
    turned_down: tuple[Candidate, Judgement] | None


@dataclass(frozen=True)
class Search:
    """The search for what is missing in the recordings in question.

    Args:
        evidence: Residuals and columns.
        weights: Noise model.
        belief: What nominal recordings, or priors, say of the common coefficients.
        executor: Runs fits.
        rng: Of bootstraps.
        solve: Effects that are fitted again on the model itself once accepted, by where they enter it.
        ring: Frequencies of the swing, where arms were released.
        advance: Called with 1 after each step.
        kept: Residuals under fits that were asked for.
    """

    evidence: Evidence
    weights: Weights
    belief: Belief
    executor: Executor
    rng: np.random.Generator
    solve: frozenset[str] = frozenset()
    ring: Ring | None = None
    advance: Callable[[float], None] = lambda _: None
    kept: dict[tuple[object, ...], list[Floats]] = field(default_factory=dict, compare=False)

    def run(self) -> Choice:
        """Add effects while they hold."""
        accepted: list[Accepted] = []
        fit: Fit | None = None
        alarm_p, turned_down = 1.0, None
        refused: frozenset[int] = frozenset()
        while len(accepted) < MOST:
            parts = self.parts(fit)
            marginal = Marginal.of(
                self.belief, total(_searched(parts), self.evidence.size), self.weights.share
            )
            taken = frozenset(a.candidate.number for a in accepted) | refused
            ranked = self.screen(marginal, taken)
            null = self.null(marginal)
            if not accepted:
                alarm_p = float((null >= ranked[0][1]).mean()) if ranked else 1.0
            if not ranked or ranked[0][1] <= 0.0:
                break
            field = self.finalists(fit, ranked[:FINALISTS])
            self.advance(1.0)
            if not field:
                break
            found, turned_down = self.best(field, fit, null, accepted)
            if found is None:
                break
            accepted.append(found)
            fit = self.refit(fit.joined(found.candidate.fit) if fit else found.candidate.fit)
            self.advance(1.0)
            accepted, fit, dropped = self.pruned(accepted, fit)
            refused |= dropped
        return Choice(tuple(accepted), fit, alarm_p, turned_down)

    def parts(self, fit: Fit | None) -> list[Products]:
        """Give the products of the residuals that accepted effects leave, without nominal recordings."""
        residuals = self.residuals(fit)
        return [part for part in self.evidence.products(self.weights, residuals) if not part.nominal]

    def residuals(self, fit: Fit | None) -> list[Floats]:
        """Give the residuals that accepted effects leave; nominal recordings have none of them."""
        if fit is None:
            return list(self.evidence.residuals)
        key = (
            fit.exact,
            *((h.name, str(h.place), *t) for h, t in zip(fit.hypotheses, fit.thetas, strict=True)),
        )
        if key not in self.kept:
            self.kept[key] = [
                residual if stage.session.nominal else residual - self.change(stage, fit)
                for stage, residual in zip(self.evidence.stages, self.evidence.residuals, strict=True)
            ]
        return self.kept[key]

    def change(self, stage: Stage, fit: Fit) -> Floats:
        """Give what the effects of a fit change in a session, shape (samples, rows)."""
        placed = [
            h.placed(stage.world, theta)
            for h, theta in zip(fit.hypotheses, fit.thetas, strict=True)
            if h.place.sensor in (None, *stage.world.sensors)
        ]
        return stage.change(placed, exact=fit.exact)

    def screen(self, marginal: Marginal, taken: frozenset[int]) -> list[tuple[int, float, Floats]]:
        """Rank hypotheses by their linear gain less the price of their parameters, with a start each."""
        best: dict[int, tuple[float, Floats]] = {}
        price = np.log(max(marginal.count, 2.0))
        directions = self.evidence.library.directions
        for number, _, columns in self.evidence.library.groups():
            if number in taken:
                continue
            own = [self.evidence.nuisances + c for c in columns]
            if marginal.matrix[own, own].min() <= INVISIBLE:
                continue
            gain, values = marginal.gain(own)
            effect = self.evidence.library.hypotheses[number].effect
            theta, allowed = _start(effect.parameters, [directions[c] for c in columns], values)
            score = (gain if allowed else 0.0) - price * len(effect.parameters)
            if number not in best or score > best[number][0]:
                best[number] = (score, theta)
        ranked = [(number, score, theta) for number, (score, theta) in best.items()]
        return sorted(ranked, key=lambda entry: -entry[1])

    def null(self, marginal: Marginal) -> Floats:
        """Draw the best score of the whole screen where nothing is missing, shape (draws,)."""
        first = self.evidence.nuisances
        drawn = marginal.null_draws(self.rng, DRAWS, first)
        price = np.log(max(marginal.count, 2.0))
        best = np.full(DRAWS, -np.inf)
        for number, _, columns in self.evidence.library.groups():
            own = [self.evidence.nuisances + c for c in columns]
            if marginal.matrix[own, own].min() <= INVISIBLE:
                continue
            block = marginal.matrix[np.ix_(own, own)]
            size = np.sqrt(np.maximum(np.diag(block), 1e-300))
            scaled = block / np.outer(size, size) + 1e-6 * np.eye(len(own))
            whitened = drawn[:, [k - first for k in own]] / size
            gains = (whitened * np.linalg.solve(scaled, whitened.T).T).sum(axis=1)
            parameters = len(self.evidence.library.hypotheses[number].effect.parameters)
            best = np.maximum(best, gains - price * parameters)
        return best

    def ground(self, fit: Fit | None = None) -> Ground:
        """Prepare nonlinear fits, to what a fit leaves, on the searched stretches of the recordings."""
        views = []
        residuals = self.residuals(fit)
        for number, stage in enumerate(self.evidence.stages):
            session = stage.session
            if session.nominal or session.heldout.all():
                continue
            residual = residuals[number]
            used = np.isfinite(residual) & ~session.heldout[:, None]
            weight = used / self.evidence.scale(self.weights, number)
            common = self.evidence.columns[number] * weight[..., None].astype(np.float32)
            left = np.nan_to_num(residual) * weight
            views.append(View(stage, left, weight, common.reshape(-1, self.evidence.size)))
        seen = total(_searched(self.parts(fit)), self.evidence.size)
        return Ground.of(views, self.belief, self.weights.share, seen)

    def finalists(self, fit: Fit | None, ranked: Sequence[tuple[int, float, Floats]]) -> list[Candidate]:
        """Fit hypotheses to what is left by those accepted already, the best first."""
        ground = self.ground(fit)
        price = np.log(max(self.count(), 2.0))
        hypotheses = self.evidence.library.hypotheses
        found = []
        for number, _, theta in ranked:
            try:
                own = fit_effects(ground, (hypotheses[number],), (theta,))
                own = own if fit else self.heard(own)
            except np.linalg.LinAlgError:
                continue
            gain = own.gain
            if not np.isfinite(gain):
                continue
            bic = gain - price * len(theta) - _surprise(hypotheses[number], own.thetas[-1])
            found.append(Candidate(number, own, gain, bic))
            self.advance(1.0)
        found.sort(key=lambda candidate: -candidate.delta_bic)
        least = max(LEAST_BIC, WORTH * found[0].delta_bic) if found else 0.0
        likely = [one for one in found[:RESOLVED] if one.delta_bic > least]
        found[: len(likely)] = [self.resolved(candidate, ground) for candidate in likely]
        return self.plainest_first(sorted(found, key=lambda candidate: -candidate.delta_bic))

    def resolved(self, candidate: Candidate, ground: Ground) -> Candidate:
        """Fit a candidate again on the model itself; keep what fits better.

        A strong effect brings the arm to where nominal recordings have not been: there the model may err more
        than its linearisation does.
        """
        fit = candidate.fit
        if not self.solvable(fit) or fit.exact:
            return candidate
        if abs(gain_of(ground, fit.hypotheses, fit.thetas) - fit.gain) < ALIKE:
            return candidate
        again = fit_effects(ground, fit.hypotheses, fit.thetas, exact=True, iterations=EXACT_STEPS)
        if again.gain <= fit.gain:
            return candidate
        theta = again.thetas[-1]
        surprise = _surprise(self.evidence.library.hypotheses[candidate.number], theta)
        bic = again.gain - np.log(max(self.count(), 2.0)) * len(theta) - surprise
        return Candidate(candidate.number, again, again.gain, bic)

    def solvable(self, fit: Fit) -> bool:
        """Tell whether the effects of a fit can be solved on the model itself."""
        kinds = {h.effect.hook for h in fit.hypotheses}
        return kinds <= self.solve and not any(h.name in ANSWERING for h in fit.hypotheses)

    def plainest_first(self, field: list[Candidate]) -> list[Candidate]:
        """Put the one with the fewest and likeliest numbers first among those as good as the best."""
        if not field:
            return field
        margin = max(ALIKE, ALIKE_SHARE * field[0].delta_bic)
        alike = [one for one in field if one.delta_bic > field[0].delta_bic - margin]
        hypotheses = self.evidence.library.hypotheses

        def plain(one: Candidate) -> tuple[int, float]:
            theta = one.fit.thetas[-1]
            return len(theta), _surprise(hypotheses[one.number], theta)

        return [*sorted(alike, key=plain), *field[len(alike) :]]

    def count(self) -> float:
        """Give the effective number of searched samples."""
        seen = 0
        for stage, residual in zip(self.evidence.stages, self.evidence.residuals, strict=True):
            if not stage.session.nominal:
                seen += int(np.isfinite(residual[~stage.session.heldout]).sum())
        return seen * self.weights.share

    def best(
        self, field: Sequence[Candidate], fit: Fit | None, null: Floats, accepted: Sequence[Accepted]
    ) -> tuple[Accepted | None, tuple[Candidate, Judgement] | None]:
        """Judge the best candidates and take the first that holds.

        What changes the arm at rest comes before what only changes how it moves, unless it explains far less;
        once an accepted effect has changed material or mass, another swing is its consequence. What one law
        leaves of a strong effect looks like a weaker second effect, which has to show in every recording.
        """
        turned_down = None
        certain = max([CERTAIN, *(SECOND * one.candidate.delta_bic for one in accepted)])
        weighty = any(self.changes_swing(one.candidate) for one in accepted)
        field = [one for one in field if not (weighty and self.changes_swing(one) and self.only_moves(one))]
        highest = max((one.delta_bic for one in field), default=0.0)
        for moving, share in ((False, MOVING), (True, CLOSE)):
            own = [one for one in field if self.only_moves(one) == moving]
            least = max(LEAST_BIC, share * highest, CLOSE * max((one.delta_bic for one in own), default=0.0))
            for candidate in own[:TRIED]:
                if candidate.delta_bic < least or candidate.fit.at_bound:
                    continue
                judgement = replace(self.judge(candidate, fit, null), certain=certain)
                if judgement.accepted:
                    return Accepted(candidate, judgement, tuple(field)), None
                turned_down = turned_down or (candidate, judgement)
        return None, turned_down

    def changes_swing(self, candidate: Candidate) -> bool:
        """Tell whether a candidate changes stiffness or mass, and with them how the arm swings."""
        effect = self.evidence.library.hypotheses[candidate.number].effect
        return effect.hook == "couple" or effect.name in HEAVY

    def only_moves(self, candidate: Candidate) -> bool:
        """Tell whether a candidate leaves the arm at rest as it is."""
        return "delay" in self.evidence.library.hypotheses[candidate.number].effect.equivalence

    def judge(self, candidate: Candidate, fit: Fit | None, null: Floats) -> Judgement:
        """Judge a candidate by what it predicts where it was not fitted."""
        parts = _searched(self.extended(candidate, fit))
        search_p = float((null >= candidate.delta_bic).mean())
        unseen = (self.belief, self.weights.share, self.evidence.size)
        return judge(parts, *unseen, self.rng, search_p, candidate.delta_bic)

    def extended(self, candidate: Candidate, fit: Fit | None) -> list[Products]:
        """Give the products with the candidate's change as one more column."""
        before = self.residuals(fit)
        plain = self.evidence.products(self.weights, before)
        found = []
        for number, stage in enumerate(self.evidence.stages):
            if stage.session.nominal:
                continue
            found += with_column(
                [part for part in plain if part.session == number],
                before[number],
                self.evidence.columns[number],
                self.change(stage, candidate.fit),
                self.evidence.scale(self.weights, number),
                stage.session.blocks,
            )
        return found

    def pruned(self, accepted: list[Accepted], fit: Fit) -> tuple[list[Accepted], Fit | None, frozenset[int]]:
        """Drop effects whose sizes are no longer told from none once all are fitted together."""
        needed = [k for k in range(len(accepted)) if _told(fit, k)]
        if len(needed) == len(accepted):
            return accepted, fit, frozenset()
        dropped = frozenset(accepted[k].candidate.number for k in range(len(accepted)) if k not in needed)
        left = self.subset(fit, needed)
        kept = [accepted[k] for k in needed]
        return kept, self.refit(left) if left is not None else None, dropped

    def without(self, choice: Choice, dropped: Sequence[int]) -> Choice:
        """Take effects back, and fit the others again."""
        kept = [k for k in range(len(choice.accepted)) if k not in dropped]
        left = self.subset(choice.fit, kept) if choice.fit is not None else None
        fit = self.refit(left) if left is not None else None
        return replace(choice, accepted=tuple(choice.accepted[k] for k in kept), fit=fit)

    def subset(self, fit: Fit, kept: Sequence[int]) -> Fit | None:
        """Keep some effects of a fit as they are; ``None`` where none is kept."""
        if not kept:
            return None
        return replace(
            fit,
            hypotheses=tuple(fit.hypotheses[k] for k in kept),
            thetas=tuple(fit.thetas[k] for k in kept),
        )

    def refit(self, fit: Fit) -> Fit:
        """Fit all accepted effects together, on the model itself where that is affordable."""
        ground = self.ground()
        found = fit_effects(ground, fit.hypotheses, fit.thetas)
        if self.solvable(fit):
            again = fit_effects(ground, found.hypotheses, found.thetas, exact=True, iterations=EXACT_STEPS)
            found = max(found, again, key=lambda one: one.gain)
        return self.heard(found)

    def heard(self, fit: Fit) -> Fit:
        """Let a fit take note of the frequency of the swing, where one was heard."""
        return self.ring.heard(fit) if self.ring is not None else fit


def _surprise(hypothesis: Hypothesis, theta: Floats) -> float:
    """Give how unlikely the sizes of an effect are beforehand, as a cost."""
    sizes = [
        (value / parameter.spread) ** 2
        for parameter, value in zip(hypothesis.effect.parameters, theta.tolist(), strict=True)
        if parameter.role == "amplitude"
    ]
    return float(min(sum(sizes), MOST_SURPRISE))


def _told(fit: Fit, number: int) -> bool:
    """Tell whether some amplitude of an effect is told from none."""
    effect, theta, stds = fit.hypotheses[number].effect, fit.thetas[number], fit.stds(number)
    sizes = [
        abs(value) / max(std, 1e-300)
        for parameter, value, std in zip(effect.parameters, theta, stds, strict=True)
        if parameter.role == "amplitude"
    ]
    return bool(max(sizes) >= TOLD)


def _start(
    parameters: Sequence[Parameter], directions: Sequence[Direction], values: Floats
) -> tuple[Floats, bool]:
    """Turn linear coefficients into parameters to start from; whether their signs are allowed."""
    theta = directions[0].theta.copy()
    allowed = True
    for direction, value in zip(directions, values.tolist(), strict=True):
        if direction.parameter < 0:
            allowed = allowed and value > 0.0
            continue
        bounds = parameters[direction.parameter]
        if bounds.lower >= 0.0 and value < 0.0 and len(directions) == 1:
            allowed = False
        theta[direction.parameter] = float(np.clip(value * direction.typical, bounds.lower, bounds.upper))
    return theta, allowed


def _searched(parts: Sequence[Products]) -> list[Products]:
    return [part for part in parts if not part.heldout]
