"""Which physics to accept: one effect at a time, judged by what it predicts where it was not fitted."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.candidates import (
    ALIKE,
    Accepted,
    Candidate,
    ChosenEffects,
    alike_within,
    is_distinguishable,
    is_moved,
    plainest_first,
    restates,
)
from softarm.estimator.diagnosis.evidence import RegressionProblem
from softarm.estimator.diagnosis.excursions import excursions_of, samples_near_one_pose
from softarm.estimator.diagnosis.fit import (
    Fit,
    MarginalisedProblem,
    change_by,
    fit_effects,
    fit_laws,
    gain_of,
)
from softarm.estimator.diagnosis.gaussian import NOTHING, Gaussian
from softarm.estimator.diagnosis.judge import ANY_SIZE, CERTAIN, FoldCosts, Judgement, fold_costs, judge
from softarm.estimator.diagnosis.marginal import Combinations, Marginal, Marginaliser, cost_of
from softarm.estimator.diagnosis.natural_frequency import NaturalFrequency
from softarm.estimator.diagnosis.nominal import UNKNOWN, background_of, usual_recordings
from softarm.estimator.diagnosis.normal_equations import NewColumns, Total, added
from softarm.estimator.diagnosis.probability import BARE, probabilities, spent
from softarm.estimator.diagnosis.recent import Recent
from softarm.estimator.diagnosis.remainder import KEPT, FreeSizes, Remainder
from softarm.estimator.diagnosis.screen import null_scores, screen, usual_gains
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.diagnosis.weights import Weights
from softarm.estimator.effects import Effect, ParameterSpec
from softarm.estimator.specimen.physics import EffectName

MOST = 4
"""Largest number of effects."""
FINALISTS = 10
"""Hypotheses that are fitted in each round."""
TRIED = 4
"""Best of them that may be accepted."""
LEAST_BIC = 25.0
"""Gain in the criterion from which an effect may be named.

Of 186 unchanged arms of two simulators four had an effect that held and gained 10 or more, which is very
strong evidence if the noise model is right (Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773): up to 21,
and 6 more than 10 on average. If such gains are exponential, one arm in 500 gains 25:
4 / 186 exp(-15 / 6).
"""
SECOND = 0.5
"""Share of an accepted effect's gain that decides for another one so."""
DELAY_SHARE = 0.05
"""Share of the gain of an effect on the vibration below which a delay is its consequence."""
TINY = 1e-12
"""Least weighted squares of a change."""
SIZES = (-2.0, -1.0, 1.0, 2.0, 4.0, 8.0)
"""Sizes, in typical ones, at which effects that detune the arm are tried: a fit finds those between."""
EXACT_STEPS = 6
"""Steps tried by a fit on the model itself."""
RESOLVED = 4
"""Best finalists that are fitted so."""
WORTH = 0.25
"""Share of the best gain in the criterion from which that is done."""


@dataclass(frozen=True)
class Search:
    """The search for what is missing in the recordings in question.

    Args:
        evidence: Residuals and columns.
        weights: Noise model.
        prior: Of the common coefficients, from nominal recordings where there are some.
        rng: Of bootstraps.
        width: What that prior takes to change from run to run, in typical sizes.
        solve: Effects that are fitted again on the model itself once accepted, by where they enter it.
        natural_frequency: Those measured, where arms were released.
        suspected: Effects that the prior leaves to the search where there are no nominal recordings.
        advance: Called with 1 after each step.
        remainders: What accepted effects last asked for leave, by their fit.
        freed: The same with free sizes.
        starts: Where fits of effects that detune the arm begin, by their number.
        tried: Candidates by their number and what was accepted before them.
        settled: Those of them that have been fitted on the model itself, whichever fit was kept.
        predictions: How well folds are predicted, by the candidate's fit and what was accepted before it.
        refitted: Joint fits, by where they began.
    """

    evidence: RegressionProblem
    weights: Weights
    prior: Gaussian
    rng: np.random.Generator
    width: float = UNKNOWN
    solve: frozenset[str] = frozenset()
    natural_frequency: NaturalFrequency | None = None
    suspected: frozenset[EffectName] = frozenset()
    advance: Callable[[float], None] = lambda _: None
    remainders: Recent[Remainder] = field(default_factory=partial(Recent, KEPT), compare=False)
    freed: Recent[Remainder] = field(default_factory=partial(Recent, KEPT), compare=False)
    starts: dict[int, list[Floats]] = field(default_factory=dict, compare=False)
    tried: dict[tuple[object, ...], Candidate | None] = field(default_factory=dict, compare=False)
    settled: set[tuple[object, ...]] = field(default_factory=set, compare=False)
    predictions: dict[tuple[object, ...], FoldCosts] = field(default_factory=dict, compare=False)
    refitted: dict[tuple[object, ...], Fit] = field(default_factory=dict, compare=False)

    def run(self, refused: frozenset[int] = frozenset()) -> ChosenEffects:
        """Add effects while they hold.

        Args:
            refused: Numbers of hypotheses that are left out.
        """
        accepted: list[Accepted] = []
        fit: Fit | None = None
        alarm_p, turned_down = 1.0, None
        while len(accepted) < MOST:
            left = self.left_free(fit)
            marginal = left.marginal
            taken = frozenset(a.candidate.number for a in accepted) | refused
            ranked = screen(self.evidence, marginal, taken)
            null = null_scores(self.evidence, marginal, self.rng)
            if not accepted:
                alarm_p = float((null >= ranked[0][1]).mean()) if ranked else 1.0
            if not ranked or ranked[0][1] <= 0.0:
                break
            problem = left.problem()
            field = self.finalists(problem, fit, self.nominated(self.at_size(ranked, problem), marginal))
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
            if fit is not None:
                accepted, fit = self.reconsidered(accepted, fit, null, refused)
        return ChosenEffects(tuple(accepted), fit, alarm_p, turned_down)

    def at_size(
        self, ranked: Sequence[tuple[int, float, Floats]], problem: MarginalisedProblem
    ) -> list[tuple[int, float, Floats]]:
        """Rank effects that detune the arm by what they explain at some size, and begin their fits there.

        A stiffer arm vibrates faster, and one on a compliant base slower. What that changes is soon out of
        step, so that a slope at zero hardly predicts a large change, even what it does at rest. A little more
        damping shortens a vibration; much of it lets the arm creep to its pose. The size that explained most
        at first is the only one that is tried beside accepted effects.
        """
        placed = []
        for number, score, theta in ranked:
            effect = (hypothesis := self.evidence.library.hypotheses[number]).effect
            best = score, theta
            if effect.detunes:
                price = self.bic_penalty * effect.degrees_of_freedom
                starts = self.starts.get(number) or at_typical_sizes(effect.parameters, theta)
                gains = [gain_of(problem, (hypothesis,), (start,), exact=False) for start in starts]
                most = int(np.argmax(gains))
                self.starts.setdefault(number, [starts[most]])
                best = max(best, (gains[most] - price, starts[most]), key=lambda one: one[0])
            placed.append((number, *best))
        return sorted(placed, key=lambda entry: -entry[1])

    def nominated(
        self, ranked: Sequence[tuple[int, float, Floats]], marginal: Marginal
    ) -> list[tuple[int, float, Floats]]:
        """List what is fitted: the best of a ranking, and an effect of which a usual share explains more."""
        if not self.evidence.has_nominal:
            return list(ranked[:FINALISTS])
        gains = usual_gains(self.evidence, marginal)
        name = max(gains, key=lambda one: gains[one], default=None)
        if name is None or gains[name] <= ranked[0][1]:
            return list(ranked[:FINALISTS])
        hypotheses = self.evidence.library.hypotheses
        return [e for k, e in enumerate(ranked) if k < FINALISTS or hypotheses[e[0]].name == name]

    def left(self, fit: Fit | None) -> Remainder:
        """Return what accepted effects leave."""
        return self.remainders.get(
            _key(fit), lambda: Remainder.of(self.evidence, self.weights, self.prior, fit)
        )

    def left_free(self, fit: Fit | None) -> Remainder:
        """Return the same with free sizes of these effects: what others are sought in."""
        if fit is None:
            return self.left(None)
        return self.freed.get(_key(fit), lambda: FreeSizes.beside(self.left(fit), fit))

    def problem(self) -> MarginalisedProblem:
        """Prepare nonlinear fits of all effects together."""
        return self.left(None).problem()

    def finalists(
        self, problem: MarginalisedProblem, fit: Fit | None, ranked: Sequence[tuple[int, float, Floats]]
    ) -> list[Candidate]:
        """Fit hypotheses to what is left by those accepted already, the best first."""
        ranked_fits = []
        for number, _, theta in ranked:
            key = (number, *_key(fit))
            if key not in self.tried:
                self.tried[key] = self.candidate(number, theta, problem, fit)
            candidate = self.tried[key]
            if candidate is not None:
                ranked_fits.append(candidate)
            self.advance(1.0)
        ranked_fits.sort(key=lambda candidate: -candidate.delta_bic)
        least = max(LEAST_BIC, WORTH * ranked_fits[0].delta_bic) if ranked_fits else 0.0
        likely = [one for one in ranked_fits[:RESOLVED] if one.delta_bic > least]
        for index, one in enumerate(likely):
            key = (one.number, *_key(fit))
            if key not in self.settled:
                self.settled.add(key)
                ranked_fits[index] = self.tried[key] = self.resolved(one, problem, fit)
        return plainest_first(sorted(ranked_fits, key=lambda candidate: -candidate.delta_bic))

    def candidate(
        self, number: int, theta: Floats, problem: MarginalisedProblem, accepted: Fit | None
    ) -> Candidate | None:
        """Fit a hypothesis to first order beside what is accepted; ``None`` where that fails."""
        try:
            fit = fit_effects(problem, (self.evidence.library.hypotheses[number],), (theta,))
            fit = self.conditioned(fit, beside=accepted)
        except np.linalg.LinAlgError:
            return None
        return self.weighed(number, fit, accepted) if np.isfinite(fit.gain) else None

    def weighed(self, number: int, fit: Fit, accepted: Fit | None) -> Candidate:
        """Set the gain of a fit, beside what nominal recordings have of it, against its parameters."""
        candidate = Candidate(number, fit, -np.inf)
        gain = (
            self.predicted(candidate, accepted).changed_gain if self.has_background(candidate) else fit.gain
        )
        return replace(candidate, delta_bic=gain - spent(candidate, self.bic_penalty))

    def resolved(self, candidate: Candidate, problem: MarginalisedProblem, accepted: Fit | None) -> Candidate:
        """Fit a candidate again by its other laws, and on the model itself; keep what fits better.

        A strong effect brings the arm to where nominal recordings have not been: there the model may err more
        than its linearisation does.
        """
        fit = candidate.fit
        if fit.hypotheses[-1].effect.has_choices and not fit.exact:
            best = self.conditioned(fit_laws(problem, fit.hypotheses, fit.thetas), beside=accepted)
            if best.gain > fit.gain:
                candidate, fit = self.weighed(candidate.number, best, accepted), best
        if not self.solvable(fit) or fit.exact:
            return candidate
        gain = gain_of(problem, fit.hypotheses, fit.thetas)
        if accepted is None and self.natural_frequency is not None:
            gain += self.natural_frequency.gain_of(fit)
        if abs(gain - fit.gain) < ALIKE:
            return candidate
        again = fit_effects(problem, fit.hypotheses, fit.thetas, exact=True, iterations=EXACT_STEPS)
        again = self.conditioned(again, beside=accepted)
        return self.weighed(candidate.number, again, accepted) if again.gain > fit.gain else candidate

    def solvable(self, fit: Fit, *, answering: bool = False) -> bool:
        """Return whether the effects of a fit can be solved on the model itself.

        Args:
            fit: The effects.
            answering: Whether loads that answer to the model, which take many solves, may be among them.
        """
        kinds = {h.effect.hook for h in fit.hypotheses}
        fast = answering and "constitutive" in self.solve
        return kinds <= self.solve and (
            fast or not any(h.effect.responds_to_own_effect for h in fit.hypotheses)
        )

    @cached_property
    def bic_penalty(self) -> float:
        """What a parameter costs: the logarithm of the effective number of searched samples."""
        samples = 0
        for stage, residual in zip(self.evidence.stages, self.evidence.residuals, strict=True):
            if not stage.session.nominal:
                samples += int(np.isfinite(residual[~stage.session.heldout]).sum())
        return float(np.log(max(samples * self.weights.effective_sample_fraction, 2.0)))

    def best(
        self, field: Sequence[Candidate], fit: Fit | None, null: Floats, accepted: Sequence[Accepted]
    ) -> tuple[Accepted | None, tuple[Candidate, Judgement] | None]:
        """Judge the most probable candidates and take the first that holds.

        Once an accepted effect has changed material or mass, another vibration is its consequence. What
        one law leaves of a strong effect looks like a weaker second effect, which every recording must show.
        Where only effects at their bounds explain anything, the best of them is turned down: something acts.
        """
        turned_down = None
        certain = max([CERTAIN, *(SECOND * one.candidate.delta_bic for one in accepted)])
        field = [
            one
            for one in field
            if not self.another_vibration(one, field, accepted) and not self.another_stretch(one, accepted)
        ]
        for candidate in self.likely(field, fit)[:TRIED]:
            judgement = replace(self.judge(candidate, fit, null), certain=certain)
            if judgement.accepted:
                return Accepted(candidate, judgement, tuple(field)), None
            turned_down = turned_down or (candidate, judgement)
        bounded = next((one for one in field if one.fit.at_bound and one.delta_bic >= LEAST_BIC), None)
        if turned_down is None and bounded is not None:
            turned_down = bounded, self.judge(bounded, fit, null)
        return None, turned_down

    def likely(self, field: Sequence[Candidate], fit: Fit | None) -> list[Candidate]:
        """List what may be accepted: the most probable candidates, and those that come close to them.

        What changes the arm at rest comes first, then what has fewer parameters, then what is more probable.
        A law that states no more than a plainer one is left out.
        """
        able = [one for one in field if one.delta_bic >= LEAST_BIC and not one.fit.at_bound]
        able = [one for one in able if not any(restates(one.fit, other.fit) for other in able)]
        if not able:
            return []
        costs = [self.predicted(one, fit) for one in able]
        weights = probabilities(able, costs, self.bic_penalty, self.rng)
        gains = np.array(
            [
                own.gain + float(own.usual.sum()) - spent(one, self.bic_penalty)
                for one, own in zip(able, costs, strict=True)
            ]
        )
        close = gains >= gains.max() - alike_within(float(gains.max()))
        near = np.flatnonzero(close | (weights >= weights.max() / BARE)).tolist()
        near.sort(key=lambda k: (self.only_moves(able[k]), len(able[k].fit.thetas[-1]), -weights[k]))
        return [able[k] for k in near]

    def another_vibration(
        self, candidate: Candidate, field: Sequence[Candidate], accepted: Sequence[Accepted]
    ) -> bool:
        """Return whether a candidate is a consequence of accepted effects on stiffness or mass.

        A change of the vibration is one unless it gains half as much as they do; a delay if it gains little
        beside them, or less than some change of the vibration does.
        """
        weighty = self.weighty(accepted)
        if not weighty or not self.only_moves(candidate):
            return False
        if self.changes_vibration(candidate):
            return candidate.delta_bic < SECOND * max(weighty)
        vibrations = [one.delta_bic for one in field if self.only_moves(one) and self.changes_vibration(one)]
        return candidate.delta_bic < max([DELAY_SHARE * max(weighty), *vibrations])

    def another_stretch(self, candidate: Candidate, accepted: Sequence[Accepted]) -> bool:
        """Return whether a candidate is a force along the arm, for how another effect stretches that.

        A law of bending says little of the stretch, and a weight stretches each arm otherwise.
        """
        weighty = self.weighty(accepted)
        if not weighty or not self.effect(candidate).along_arm(candidate.fit.thetas[-1]):
            return False
        return candidate.delta_bic < SECOND * max(weighty)

    def weighty(self, accepted: Sequence[Accepted]) -> list[float]:
        """Return the gains of accepted effects that change stiffness or mass."""
        return [one.candidate.delta_bic for one in accepted if self.changes_vibration(one.candidate)]

    def changes_vibration(self, candidate: Candidate) -> bool:
        """Return whether a candidate changes stiffness or mass, and with them how the arm vibrates."""
        effect = self.effect(candidate)
        return effect.hook == "constitutive" or effect.changes_inertia

    def only_moves(self, candidate: Candidate) -> bool:
        """Return whether a candidate leaves the arm at rest as it is."""
        return "delay" in self.effect(candidate).equivalence

    def effect(self, candidate: Candidate) -> Effect:
        """Return the effect of a candidate."""
        return self.evidence.library.hypotheses[candidate.number].effect

    def judge(self, candidate: Candidate, fit: Fit | None, null: Floats) -> Judgement:
        """Judge a candidate by what it predicts where it was not fitted.

        All samples of the only excursion in which an effect was seen are one, and must be as certain.
        """
        search_p = float((null >= candidate.delta_bic).mean())
        judgement = judge(self.predicted(candidate, fit), self.rng, search_p, candidate.delta_bic)
        if not judgement.accepted:
            return judgement
        seen = excursions_of(self.weighted_squares(candidate, fit))
        if not seen.once:
            return judgement
        return replace(judgement, least=CERTAIN * self.weights.effective_sample_fraction * seen.samples)

    def weighted_squares(
        self, candidate: Candidate, fit: Fit | None
    ) -> Iterator[tuple[Floats, Floats, float]]:
        """Yield what ``excursions_of`` takes of a candidate's change beside a fit, by recording in question.

        Weighted squares of reported samples are zero. Those of samples that confirm count: if they do not
        show the effect, it is taken back.
        """
        for number, stage in enumerate(self.evidence.stages):
            session = stage.session
            if not session.nominal:
                used = np.isfinite(self.evidence.residuals[number]) & ~session.reported[:, None]
                change = change_by(stage, candidate.fit, fit) / self.evidence.scale(self.weights, number)
                squares = np.sum(np.where(used, np.nan_to_num(change), 0.0) ** 2, axis=1)
                yield session.clock, squares, self._samples_near_one_pose[number]

    @cached_property
    def _samples_near_one_pose(self) -> dict[int, float]:
        """How long the arm stays near one pose in each session in question, in samples, by its number."""
        return {
            number: samples_near_one_pose(stage.reading_rows)
            for number, stage in enumerate(self.evidence.stages)
            if not stage.session.nominal
        }

    def predicted(self, candidate: Candidate, fit: Fit | None) -> FoldCosts:
        """Return how well folds of the searched stretches are predicted with a candidate and without."""
        key = (_key(candidate.fit), _key(fit))
        if key not in self.predictions:
            left = self.left_free(fit)
            folds, new = left.folds, left.new_columns(self.changes(candidate, fit))
            prior, wanted = NOTHING, None
            if self.has_background(candidate):
                prior, wanted = self.background(candidate, added(new), folds.whole.data)
            columns = folds.columns(new, wanted)
            shown = folds.marginal(columns)
            fraction = self.weights.effective_sample_fraction
            changed = [fraction * sum(float(new[k].matrix[0, 0]) for k in fold) for fold in folds.numbers]
            beside = prior.augment(0.0, ANY_SIZE)
            before = cost_of(prior, shown.whole.selected(range(len(prior.mean))), 1.0)
            costs = fold_costs(shown, prior, np.array(changed))
            # Without nominal recordings a calibration can follow almost anything: only prediction decides.
            if self.evidence.has_nominal:
                after = folds.shares(columns, shown.whole, beside)
                without = folds.shares(columns, shown.whole, prior) if wanted else folds.plain_shares
                costs = replace(costs, gains=without - after, usual=folds.plain_shares - without)
            self.predictions[key] = replace(
                costs,
                frequency_gain=self.frequency_gain(candidate, fit),
                changed_gain=before - cost_of(beside, shown.whole, 1.0),
            )
        return self.predictions[key]

    def changes(self, candidate: Candidate, beside: Fit | None = None) -> Callable[[Stage], Floats]:
        """Return what gives the change by a candidate in a session beside a fit, shape (samples, rows, 1)."""
        return lambda stage: change_by(stage, candidate.fit, beside)[..., None]

    def has_background(self, candidate: Candidate) -> bool:
        """Return whether nominal recordings may have a little of a candidate."""
        return self.evidence.has_nominal and self.effect(candidate).in_healthy_arms

    @cached_property
    def usual(self) -> Marginaliser:
        """The nominal recordings."""
        return usual_recordings(self.evidence, self.weights)

    def nominal_columns(self, more: Callable[[Stage], Floats]) -> list[NewColumns]:
        """Return the products of new columns in the nominal recordings."""
        parts = [part for part in self.evidence.products(self.weights) if part.nominal]
        return self.evidence.with_columns(self.weights, more, parts)

    def background(self, candidate: Candidate, new: NewColumns, seen: Total) -> tuple[Gaussian, Combinations]:
        """Add what nominal recordings have of a candidate to what is common to all recordings.

        Args:
            candidate: The candidate.
            new: Products of its change in the searched stretches.
            seen: Sum of the normal equations of these.

        Returns:
            The prior of the columns before the candidate's, and what columns these and its own are.
        """
        beyond, size = self.beyond_library(candidate, new, seen)
        one = np.ones((1, 1))
        nominal = added(self.nominal_columns(self.changes(candidate)))
        products = self.usual.combined(nominal, Combinations(one, beyond[: self.evidence.size]))
        less, prior = background_of(self.usual, products, self.width, size)
        less = np.concatenate([less, np.zeros((len(beyond) - len(less), 1))])
        common = np.concatenate([beyond - less, beyond, np.zeros_like(beyond)], axis=1)
        return prior, Combinations(np.ones((1, 3)), common)

    def beyond_library(self, candidate: Candidate, new: NewColumns, seen: Total) -> tuple[Floats, float]:
        """Return what the library's columns for a candidate do not stand for, and how large it is.

        Args:
            candidate: The candidate.
            new: Products of its change in the searched stretches.
            seen: Sum of the normal equations of these.

        Returns:
            Weights of the common columns beside its change, whose combination is what is left of it, shape
            (columns, 1); and its size in typical ones, by what it changes.
        """
        own = [
            self.evidence.nuisances + column
            for column, direction in enumerate(self.evidence.library.directions)
            if direction.hypothesis == candidate.number
        ]
        weights = np.zeros((len(seen.vector), 1))
        weights[own] = -np.linalg.lstsq(seen.matrix[np.ix_(own, own)], new.cross[own])[0]
        largest = max(float(np.diag(seen.matrix)[own].max()), TINY)
        return weights, float(np.sqrt(max(float(new.matrix[0, 0]), TINY) / largest))

    def frequency_gain(self, candidate: Candidate, fit: Fit | None) -> float:
        """Return by how much a candidate lowers the cost of the natural frequency beside a fit."""
        if self.natural_frequency is None:
            return 0.0
        joint = fit.joined(candidate.fit) if fit else candidate.fit
        return self.natural_frequency.gain_of(joint) - self.natural_frequency.gain_of(fit)

    def reconsidered(
        self, accepted: Sequence[Accepted], fit: Fit, null: Floats, refused: frozenset[int]
    ) -> tuple[list[Accepted], Fit]:
        """Choose every effect but the last again, now that those after it are known.

        An effect that is chosen while another is still unknown may stand for a part of both: a lower gain for
        more mass and a stiffness that drifts. If its size has moved, what ranks best now is tried beside its
        rivals of then. Another effect takes its place only where all effects together explain more so.
        """
        chosen = list(accepted)
        for number, one in enumerate(accepted[:-1]):
            others = [k for k in range(len(chosen)) if k != number]
            rest = self.refit(fit.selected(others))
            left = self.left_free(rest)
            taken = frozenset(chosen[k].candidate.number for k in others)
            rivals = [rival for rival in one.field if rival.number not in taken][:RESOLVED]
            ranked = [(rival.number, rival.delta_bic, rival.fit.thetas[-1]) for rival in rivals]
            problem = left.problem()
            if is_moved(fit, number, one.candidate.fit):
                known = {rival.number for rival in rivals}
                screened = self.at_size(screen(self.evidence, left.marginal, taken | refused), problem)
                likely = [entry for entry in screened if entry[1] > WORTH * screened[0][1]]
                ranked += [entry for entry in likely if entry[0] not in known][:RESOLVED]
            found, _ = self.best(
                self.finalists(problem, rest, ranked), rest, null, [chosen[k] for k in others]
            )
            if found is not None and found.candidate.number != one.candidate.number:
                again = self.refit(rest.inserted(found.candidate.fit, number))
                if self.worth(again) > self.worth(fit):
                    chosen[number], fit = found, again
        return chosen, fit

    def pruned(self, accepted: list[Accepted], fit: Fit) -> tuple[list[Accepted], Fit | None, frozenset[int]]:
        """Drop effects that are none once all are fitted together.

        Their sizes are no longer distinguishable from zero, or at a bound, where another law begins: a cord
        as stiff as a wall is one.
        """
        needed = [
            k
            for k in range(len(accepted))
            if not fit.is_bounded(k) and (is_distinguishable(fit, k) or self.contribution(fit, k) > LEAST_BIC)
        ]
        if len(needed) == len(accepted):
            return accepted, fit, frozenset()
        dropped = frozenset(accepted[k].candidate.number for k in range(len(accepted)) if k not in needed)
        reduced = self.subset(fit, needed)
        kept = [accepted[k] for k in needed]
        return kept, self.refit(reduced) if reduced is not None else None, dropped

    def contribution(self, fit: Fit, number: int) -> float:
        """Return what one effect gains in the criterion beside the others, fitted again without it.

        It is infinite where another one then ends at a bound: a cord that must be as stiff as a wall is
        another law there, and states nothing in its place.
        """
        others = self.subset(fit, [k for k in range(len(fit.thetas)) if k != number])
        if others is None:
            return self.worth(fit)
        again = self.refit(others)
        if any(again.is_bounded(k) and not others.is_bounded(k) for k in range(len(others.thetas))):
            return np.inf
        return self.worth(fit) - self.worth(again)

    def worth(self, fit: Fit) -> float:
        """Return what all effects of a fit gain in the criterion."""
        return fit.gain - self.bic_penalty * fit.degrees_of_freedom

    def without(self, choice: ChosenEffects, dropped: Sequence[int]) -> ChosenEffects:
        """Take effects back, and fit the others again."""
        kept = [k for k in range(len(choice.accepted)) if k not in dropped]
        reduced = self.subset(choice.fit, kept) if choice.fit is not None else None
        fit = self.refit(reduced) if reduced is not None else None
        return replace(choice, accepted=tuple(choice.accepted[k] for k in kept), fit=fit)

    def exchanged(self, choice: ChosenEffects, number: int, candidate: Candidate) -> ChosenEffects:
        """Put a candidate in the place of an effect, and fit all again."""
        assert choice.fit is not None
        rest = self.subset(choice.fit, [k for k in range(len(choice.accepted)) if k != number])
        accepted = list(choice.accepted)
        accepted[number] = replace(accepted[number], candidate=candidate)
        fit = self.refit(rest.inserted(candidate.fit, number) if rest else candidate.fit)
        return replace(choice, accepted=tuple(accepted), fit=fit)

    def subset(self, fit: Fit, kept: Sequence[int]) -> Fit | None:
        """Keep some effects of a fit as they are; ``None`` where none is kept."""
        return fit.selected(kept) if kept else None

    def refit(self, fit: Fit) -> Fit:
        """Fit all accepted effects together, on the model itself where that is affordable."""
        key = _key(fit)
        if key not in self.refitted:
            problem = self.problem()
            best = fit_laws(problem, fit.hypotheses, fit.thetas)
            if self.solvable(fit):
                again = fit_effects(problem, best.hypotheses, best.thetas, exact=True, iterations=EXACT_STEPS)
                best = max(best, again, key=lambda one: one.gain)
            self.refitted[key] = self.conditioned(best)
        return self.refitted[key]

    def conditioned(self, fit: Fit, *, beside: Fit | None = None) -> Fit:
        """Condition a fit on the natural frequency, where one was measured.

        One beside other effects is not: it is conditioned once all are fitted together.
        """
        if self.natural_frequency is None or beside is not None:
            return fit
        return self.natural_frequency.conditioned(fit)


def at_typical_sizes(parameters: Sequence[ParameterSpec], theta: Floats) -> list[Floats]:
    """List parameters with amplitudes of some typical sizes, either way, within their bounds."""
    amplitudes = np.array([one.role == "amplitude" for one in parameters])
    typical = np.array([one.typical for one in parameters])
    low, high = (np.array([getattr(one, bound) for one in parameters]) for bound in ("lower", "upper"))
    tried = (np.where(amplitudes, size * typical, theta) for size in SIZES)
    return [one for one in tried if ((low <= one) & (one <= high)).all()]


def _key(fit: Fit | None) -> tuple[object, ...]:
    """Return what distinguishes fits: their effects."""
    if fit is None:
        return ()
    return (
        fit.exact,
        *((h.name, str(h.place), *t) for h, t in zip(fit.hypotheses, fit.thetas, strict=True)),
    )
