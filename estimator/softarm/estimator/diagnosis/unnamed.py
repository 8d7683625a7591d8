"""What has no name: laws of the arm's state that nobody chose, as a competitor of equal standing.

A law bends segments, or lets chambers push otherwise, by functions that state no physics: hinges of a
segment's own bend or of a chamber's pressure, alike for all directions and chambers; or, where nothing is
alike, a Gaussian process of all pressures and bends, as they are and as they fade, and of the clock, in its
largest components at some of the states (Williams and Seeger, Advances in Neural Information Processing
Systems 13 (2001) 682). The likeliest law competes with the effects that were accepted, by what each predicts
of recordings that it was not fitted to.

Both together explain more than either, for no law and no effect is exact. So what decides is how much of
all that they explain, b, only one of them does: the effects b - l, where l is what the law explains alone,
and the law b - e. A law bends to whatever the model of an arm gets wrong as well, so it takes the place of
names only where its own part is twice theirs: l > (e + b) / 2, and by more than counts as alike, since names
are plainer. A law that states what an effect does in a free form contains it, so that b is l. What a strong
effect's own form leaves is no second effect below ``SECOND`` of its gain; so much more a free form must gain.
Then what was left out is not in the library, and the nearest name would be wrong. A name is
right only if the library contains what acts: its probability is that of its rivals in the library times that
no law without a name acts instead (Bernardo and Smith, Bayesian Theory (1994), section 6.1, on sets of models
that may be incomplete).

The library's columns do not stand for a law, so what nominal recordings have of one is learnt from these:
only a change of it counts. The process is not compared so. It is wide enough that whatever has changed
looks like something it had before.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.distance import cdist

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.candidates import alike_within
from softarm.estimator.diagnosis.choose import SECOND, Search
from softarm.estimator.diagnosis.fit import Fit, change_by
from softarm.estimator.diagnosis.folds import NewFolds
from softarm.estimator.diagnosis.gaussian import NOTHING, Gaussian
from softarm.estimator.diagnosis.judge import ANY_SIZE, CERTAIN
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.marginal import Combinations
from softarm.estimator.diagnosis.nominal import background_of, changed_prior, predictive
from softarm.estimator.diagnosis.normal_equations import NewColumns, Total, added
from softarm.estimator.diagnosis.probability import density, pseudo_bma
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.diagnosis.words import plain
from softarm.estimator.effects import describe
from softarm.estimator.simulation.filters import first_order
from softarm.estimator.specimen.physics import EffectName, Place

FEATURES = (24, 8, 8)
"""Functions of each bending axis: of the state, of how it fades, and of the state and the clock."""
LENGTHS = (0.5, 1.0, 2.0)
"""Lengths over which a law changes, as shares of the largest pressure and bend."""
FADING = (1.0, 10.0)
"""Times [s] over which a law forgets."""
STRAINS = (0.003, 0.01, 0.03, 0.1)
"""Sizes of the process that are tried: standard deviation of the bend that it adds [rad]."""
SHARES = (0.03, 0.1, 0.3, 1.0)
"""Sizes of the hinges that are tried: standard deviation of a change of slope, in that without the law."""
KNOTS = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75])
"""Where hinges are, as shares of the largest bend or pressure."""
LAWS_OF_BEND: frozenset[EffectName] = frozenset({"material_softening", "material_stiffening"})
"""Effects that state how a segment's stiffness changes with its bend. The hinges of that bend state the same
in a free form, which follows what the effect's own form gets wrong of the arm."""
BEND = "pose"
"""What hinges of a segment's bend vary with."""
LIKELIER = 0.5
"""Probability above which something unknown is reported: whoever acts on less errs more often than not."""
OWN_PART = 0.5
"""Share of what only the law explains that only the names must explain. It was 0.01 to 0.4 in four trials
with foreign physics, and 1 and more in thirteen in which effects of the library acted."""
POINTS = 300
"""States at which the process is known, spread over all recordings in question."""


Columns = Callable[[Stage], Floats]


@dataclass(frozen=True)
class Law:
    """A law without a name.

    Args:
        place: Where it acts.
        regime: What it varies with; empty where that may be anything.
        columns: Gives what its coefficients change in a recording, shape (samples, rows, coefficients).
        sizes: Standard deviations of the coefficients that are tried.
        compared: Whether nominal recordings show what the arm has of it when it is well.
    """

    place: Place
    regime: str
    columns: Columns
    sizes: tuple[float, ...]
    compared: bool = True


@dataclass(frozen=True)
class LawEvidence:
    """What the recordings in question show of a law of some size.

    Args:
        known: The prior without a change: of what nominal recordings have of the law, where it is compared
            with these.
        changed: The prior with a change, whose coefficients are the last.
        wanted: Which combinations of columns these are coefficients of.
        shown: The searched stretches, with the columns of ``changed``.
    """

    law: Law
    known: Gaussian
    changed: Gaussian
    wanted: Combinations
    shown: NewFolds

    def without(self) -> NewFolds:
        """Return the searched stretches without the change."""
        return self.shown.selected(range(len(self.known.mean)))


@dataclass(frozen=True)
class UnnamedLaw:
    """How a law without a name fares beside the effects that were accepted.

    Args:
        gain: Twice the logarithm of the odds on it against nothing, each recording predicted from the others.
        named_gain: The same of the accepted effects.
        probability: How probable it is that it acts and not the effects.
        nearest: The effects.
        place: Where it acts.
        regime: What it varies with; empty where that may be anything.
    """

    gain: float
    named_gain: float
    probability: float
    nearest: tuple[Hypothesis, ...]
    place: Place
    regime: str

    @property
    def outdoes(self) -> bool:
        """Whether the law is more probable than names and nothing."""
        return self.probability > LIKELIER and self.gain > CERTAIN

    def sentence(self) -> str:
        """State how far the known effects fall short of it."""
        where = f" at {describe(self.place)} and depends on the {self.regime}" if self.regime else ""
        acts = f"Something that no known effect explains acts{where}."
        if not self.nearest:
            return acts
        names = ", ".join(dict.fromkeys(plain(one.name) for one in self.nearest))
        return f"{acts} A law without a name predicts unseen recordings better than {names}."


@dataclass(frozen=True)
class SmoothFunctions:
    """The functions that a Gaussian process of the arm's state is made of, the largest first.

    Args:
        pressure: That counts as 1 [Pa].
        bends: That count as 1 [rad], shape (segments,).
        span: Of the clock that counts as 1 [s].
        points: States at which the process is known, for each kind of function, each (points, states).
        weights: Of the covariances with these, for each kind, each (points, functions).
    """

    pressure: float
    bends: Floats
    span: float
    points: tuple[Floats, ...] = ()
    weights: tuple[Floats, ...] = ()

    @classmethod
    def of(cls, stages: Sequence[Stage]) -> "SmoothFunctions":
        """Take them from the states that some recordings visit."""
        clocks = np.concatenate([stage.session.clock for stage in stages])
        scale = cls(
            max(1.0, *(float(stage.session.pressures.max(initial=0.0)) for stage in stages)),
            np.maximum(np.max([np.abs(_bends(stage)).max(axis=(0, 2)) for stage in stages], axis=0), 1e-6),
            max(float(np.ptp(clocks)), 1.0),
        )
        points, weights = [], []
        for states, count in zip(zip(*map(scale.states, stages), strict=True), FEATURES, strict=True):
            every = np.concatenate(states)
            chosen = every[np.linspace(0, len(every) - 1, min(POINTS, len(every))).astype(int)]
            values, vectors = np.linalg.eigh(_covariance(chosen, chosen))
            largest = slice(max(len(values) - count, 0), None)
            points.append(chosen)
            weights.append(vectors[:, largest] / np.sqrt(np.maximum(values[largest], 1e-9)))
        return replace(scale, points=tuple(points), weights=tuple(weights))

    def states(self, stage: Stage) -> tuple[Floats, ...]:
        """Return what each kind of function depends on, each of shape (samples, states)."""
        session = stage.session
        bends = (_bends(stage) / self.bends[:, None]).reshape(session.samples, -1)
        state = np.concatenate([session.pressures / self.pressure, bends], axis=1)
        lost = [state - first_order(session.clock, state, time, ())[0] for time in FADING]
        clock = session.clock[:, None] / self.span
        return state, np.concatenate(lost, axis=1), np.concatenate([state, clock], axis=1)

    def columns(self, stage: Stage) -> Floats:
        """Bend every segment about both axes by every function, shape (samples, rows, functions)."""
        functions = np.concatenate(
            [
                _covariance(state, known) @ weights
                for state, known, weights in zip(self.states(stage), self.points, self.weights, strict=True)
            ],
            axis=1,
        )
        slopes = stage.by_eigenstrain.reshape(*stage.by_eigenstrain.shape[:2], len(self.bends), 4)[..., :2]
        columns = np.einsum("trsa,tk->trsak", slopes, functions)
        return np.asarray(columns.reshape(*columns.shape[:2], -1), dtype=np.float64)


def _covariance(states: Floats, others: Floats) -> Floats:
    """Return the covariance of a smooth function between states, shape (states, others)."""
    squares = cdist(states, others, "sqeuclidean")
    return np.asarray(np.mean([np.exp(-0.5 * squares / length**2) for length in LENGTHS], axis=0))


def _bends(stage: Stage) -> Floats:
    """Return the bends of the segments without effects [rad], shape (samples, segments, 2)."""
    bends: Floats = np.nan_to_num(stage.arm.baseline.strains[..., :2])
    return bends


def unnamed_law(search: Search, fit: Fit | None) -> UnnamedLaw:
    """Let the likeliest law without a name compete with accepted effects, and with nothing.

    Args:
        search: The search.
        fit: The accepted effects together; ``None`` where there are none.
    """
    listed = laws(search, smooth=search.evidence.has_nominal and fit is not None)
    if fit is None:
        return _competing(search, likeliest_law(search, listed), None)
    others = [law for law in listed if not is_freer_form(law, fit)]
    freer = [law for law in listed if is_freer_form(law, fit)]
    rivals = [UnnamedLaw(0.0, 0.0, 0.0, tuple(fit.hypotheses), Place(), "")]
    rivals += [_competing(search, likeliest_law(search, some), fit) for some in (others, freer) if some]
    return max(rivals, key=lambda one: one.probability)


def is_freer_form(law: Law, fit: Fit) -> bool:
    """Return whether a law states what an accepted effect does, in a free form."""
    stated = {h.place for h in fit.hypotheses if h.name in LAWS_OF_BEND}
    return law.regime == BEND and bool(stated & {Place(), law.place})


def _competing(search: Search, of_each_size: Sequence[LawEvidence], fit: Fit | None) -> UnnamedLaw:
    """Let a law, its likeliest size first, compete with accepted effects, and with nothing."""
    shown = of_each_size[0]
    law = shown.law
    nothing = _log_densities(shown.without(), shown.known, shown.known)
    densities = [_log_densities(shown.shown, shown.known, shown.changed) - nothing, np.zeros_like(nothing)]
    gain, named_gain = 2.0 * float(densities[0].sum()), 0.0
    if fit is not None:
        price = 0.5 * search.bic_penalty * (fit.degrees_of_freedom - 1) / len(nothing)
        joint = _with_effects(search, shown, fit)
        named = joint.selected([*range(len(shown.known.mean)), len(shown.changed.mean)])
        effects = _log_densities(named, shown.known, shown.known.augment(0.0, ANY_SIZE)) - price - nothing
        named_gain = 2.0 * float(effects.sum())
        if is_freer_form(law, fit):
            names = (1.0 + SECOND) * effects
        else:
            # Beside effects a law may be smaller: what they get wrong, and not all that has changed.
            beside = max(of_each_size, key=lambda one: predictive(_of_any_size(one), joint.whole, 1.0))
            both = _log_densities(joint, beside.known, _of_any_size(beside)) - price - nothing
            names = OWN_PART * effects + (1.0 - OWN_PART) * both
        densities.append(names + 0.5 * alike_within(gain) / len(nothing))
    probability = min(float(pseudo_bma(np.column_stack(densities), search.rng)[0]), 1.0)
    nearest = () if fit is None else tuple(fit.hypotheses)
    return UnnamedLaw(gain, named_gain, probability, nearest, law.place, law.regime)


def unnamed_probability(search: Search, changed: float, disproved: Collection[int] = ()) -> float:
    """Return how probable it is that what is missing has no name, where no effect was accepted.

    A law without a name, and a change of everything at once, compete with every effect that was fitted alone,
    and with nothing. Each is learnt from the other folds and predicts one.

    Args:
        search: The search.
        changed: Twice the logarithm of the odds from which everything has changed.
        disproved: Numbers of effects that confirming data have disproved, which compete no more.
    """
    named = [
        density(one, search.predicted(one, None), search.bic_penalty)
        for key, one in search.tried.items()
        if len(key) == 1 and key[0] not in disproved and one is not None and not one.fit.at_bound
    ]
    law = likeliest_law(search, laws(search, smooth=False))[0]
    folds, fraction = search.left(None).folds, search.weights.effective_sample_fraction
    plain = NewFolds(
        folds.whole.data,
        tuple((own.data, rest.data) for own, rest in zip(folds.own, folds.rest, strict=True)),
    )
    wide = changed_prior(search.evidence, search.prior, search.width, plain.whole, fraction)
    # What changes from run to run, a prior that allows for little learns as well.
    little = _log_densities(plain, None, search.prior, fraction) + 0.5 * changed / len(folds.own)
    unnamed = [
        _log_densities(plain, None, wide, fraction) - little,
        _log_densities(law.shown, law.known, law.changed)
        - _log_densities(law.without(), law.known, law.known),
    ]
    densities = [*named, *unnamed, np.zeros_like(little)]
    return min(float(pseudo_bma(np.column_stack(densities), search.rng)[len(named) : -1].sum()), 1.0)


def _of_any_size(shown: LawEvidence) -> Gaussian:
    """Return the prior of a law and of effects beside it."""
    return shown.changed.augment(0.0, ANY_SIZE)


def likeliest_law(search: Search, listed: Sequence[Law]) -> list[LawEvidence]:
    """Return the law under which the recordings in question are likeliest, at its likeliest size first."""

    def likelihood(shown: LawEvidence) -> float:
        return predictive(shown.changed, shown.shown.whole, 1.0)

    tried = [sorted(_law_evidence(search, law), key=likelihood, reverse=True) for law in listed]
    return max(tried, key=lambda of_each_size: likelihood(of_each_size[0]))


def _law_evidence(search: Search, law: Law) -> list[LawEvidence]:
    """Return what the searched stretches show of a law, for each size that is tried."""
    new = search.left(None).new_columns(law.columns)
    count, columns = len(new[0].vector), search.evidence.size
    if not (law.compared and search.evidence.has_nominal):
        wanted = Combinations(np.eye(count), np.zeros((columns, count)))
        shown = _marginal(search, new)
        return [
            LawEvidence(law, NOTHING, NOTHING.augment(0.0, size**2, count), wanted, shown)
            for size in law.sizes
        ]
    nominal = added(search.nominal_columns(law.columns))
    priors = [background_of(search.usual, nominal, search.width, 1.0 / size) for size in law.sizes]
    wanted = Combinations(np.tile(np.eye(count), 3), np.pad(-priors[0][0], ((0, 0), (0, 2 * count))))
    shown = _marginal(search, new, wanted)
    return [
        LawEvidence(law, known, known.augment(0.0, size**2, count), wanted, shown)
        for size, (_, known) in zip(law.sizes, priors, strict=True)
    ]


def _with_effects(search: Search, shown: LawEvidence, fit: Fit) -> NewFolds:
    """Return a law's evidence with what effects change as one more column."""

    def columns(stage: Stage) -> Floats:
        return np.append(shown.law.columns(stage), change_by(stage, fit)[..., None], axis=-1)

    wanted = Combinations(
        block_diag(shown.wanted.new, np.ones((1, 1))), np.pad(shown.wanted.common, ((0, 0), (0, 1)))
    )
    return _marginal(search, search.left(None).new_columns(columns), wanted)


def _marginal(search: Search, new: Sequence[NewColumns], wanted: Combinations | None = None) -> NewFolds:
    """Return the normal equations of new columns in the searched stretches; see ``Folds.columns``."""
    folds = search.left(None).folds
    return folds.marginal(folds.columns(new, wanted))


def laws(search: Search, *, smooth: bool) -> list[Law]:
    """List the laws for the recordings in question.

    Args:
        search: The search.
        smooth: Whether any smooth law is among them. What a model gets wrong of an arm that is well is one
            too: alone, or where no nominal recording shows that arm, it is no sign that something is missing.
    """
    stages = [stage for stage in search.evidence.stages if not stage.session.nominal]
    highest = max(1.0, *(float(stage.session.pressures.max(initial=0.0)) for stage in stages))
    listed = [Law(Place(), "", SmoothFunctions.of(stages).columns, STRAINS, compared=False)] if smooth else []
    for index, segment in enumerate(stages[0].world.segments):
        largest = max(float(np.linalg.norm(_bends(stage)[:, index], axis=-1).max()) for stage in stages)
        knotted = partial(by_bend, segment=index, knots=KNOTS * largest)
        listed.append(Law(Place(segment=segment), BEND, knotted, SHARES))
    if stages[0].session.pressures.shape[1]:
        alone = partial(by_pressure, knots=KNOTS[1:] * highest)
        together = partial(by_neighbours, highest=highest)
        listed += [Law(Place(), "pressure level", one, SHARES) for one in (alone, together)]
    return listed


def by_bend(stage: Stage, segment: int, knots: Floats) -> Floats:
    """Let a segment bend further in its own direction, shape (samples, rows, knots)."""
    bends = _bends(stage)[:, segment]
    size = np.linalg.norm(bends, axis=-1)
    along = bends / np.maximum(size, 1e-6)[:, None]
    slope = np.einsum("tra,ta->tr", stage.by_eigenstrain[..., 4 * segment : 4 * segment + 2], along)
    columns: Floats = slope[..., None] * np.maximum(size[:, None] - knots, 0.0)[:, None]
    return columns


def by_pressure(stage: Stage, knots: Floats) -> Floats:
    """Let every chamber push more from some pressure on, shape (samples, rows, knots)."""
    pressures = stage.session.pressures
    slopes = stage.input_jacobian[..., : pressures.shape[1]]
    columns: Floats = np.einsum("trc,tck->trk", slopes, np.maximum(pressures[..., None] - knots, 0.0))
    return columns


def by_neighbours(stage: Stage, highest: float) -> Floats:
    """Let chambers of a segment act on one another.

    For each segment: each chamber pushes more the fuller its neighbours are; or it takes from one neighbour
    what it gives the other.

    Returns:
        Shape (samples, rows, 2 segments).
    """
    pressures = stage.session.pressures
    slopes = stage.input_jacobian[..., : pressures.shape[1]]
    columns = []
    for index in range(len(stage.world.segments)):
        chambers = [c for c, segment in enumerate(stage.world.chamber_segment) if segment == index]
        inside = pressures[:, chambers]
        together = inside * (inside.sum(axis=1, keepdims=True) - inside) / highest
        around = np.roll(inside, 1, axis=1) - np.roll(inside, -1, axis=1)
        columns += [np.einsum("trc,tc->tr", slopes[..., chambers], change) for change in (together, around)]
    return np.stack(columns, axis=-1)


def _log_densities(shown: NewFolds, known: Gaussian | None, prior: Gaussian, fraction: float = 1.0) -> Floats:
    """Return the logarithm of the density of each fold, given what the others teach, shape (folds,).

    Args:
        shown: The folds.
        known: Prior of the first coefficients, which the other folds do not teach: what has followed a change
            would hide it; ``None`` where they teach all.
        prior: Of all coefficients.
        fraction: Effective sample fraction of the folds' counts.
    """
    return np.array(
        [
            0.5 * predictive(learnt, own, fraction)
            for learnt, own in _learnt_from_others(shown, known, prior, fraction)
        ]
    )


def _learnt_from_others(
    shown: NewFolds, known: Gaussian | None, prior: Gaussian, fraction: float
) -> Iterator[tuple[Gaussian, Total]]:
    """Yield what the others teach of the coefficients, with each fold; see ``_log_densities``."""
    for own, others in shown.folds:
        learnt = prior.posterior(others, fraction)
        yield (learnt if known is None else learnt.with_first(known)), own
