"""Every number that can move a verdict, with where it comes from.

One set for all runs. A number with no other source was chosen by hand on development cases: simulated recordings of
seeds that no published figure uses. `bench/discrepancy_sensitivity.py` halves and doubles each.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SplitSettings:
    """Who may look at which rows."""

    # Of the trajectories: discovery, confirmation, test set. Asked for by the design of the method.
    fractions: tuple[float, float, float] = (0.6, 0.2, 0.2)
    # Fewer whole trajectories are cut into blocks.
    min_units: int = 10
    # From there on the split is by session, one at least for each part. Asked for by the design of the method.
    min_sessions: int = 3
    # Of a session's trajectories, in which what is new in it (a homing) is learned.
    opening: float = 0.2
    # Of a block's length, left out between blocks so that slow noise does not reach across.
    guard: float = 0.05
    # Condensed rows that evidence is taken from: above, time grows and results hardly change.
    most_rows: int = 9000


@dataclass(frozen=True)
class NoiseSettings:
    """What of a residual is noise."""

    # Times the stated noise: from there on the recording's own is believed.
    noisier: float = 1.25
    # s between samples at most: beyond, neighbouring samples differ by motion, not by noise.
    dense: float = 0.06
    # s that a rounding error stays the same: about a joint's time from count to count.
    rounded_for: float = 0.5
    # Samples in holds, without which the whole recording is used.
    min_pairs: int = 200
    # s; beyond, motion and noise can no longer be separated.
    longest_lag: float = 0.8
    # Degrees of freedom, between normal noise and the heavy tails of sensors.
    likely_tail: float = 8.0
    # Robust standard deviations from the running median: in normal noise one sample in 5e8.
    spike: float = 6.0
    # Samples in a row that a sensor's fault may last; what lasts longer is the machine.
    longest_spike: int = 2
    # rad or m; finer residuals are rounding of what logs write down.
    floor: float = 1e-6
    # Of the outside sensor's noise (a tracker's over the joint's lever): an error of the motors below it does not
    # matter. A definition.
    motor_fraction: float = 1.0
    # rad or m, the same where nothing outside sees what a joint moves.
    motor_floor: float = 2e-4
    # rad; standard deviation of the angles of a calibrated table and registration.
    table_angle: float = 1e-4
    # m; the same of its lengths.
    table_length: float = 2e-5
    # rad RMS between measured and simulated orientations, once the marker is turned on the tip: beyond, what is tracked
    # is no body fixed to the tool. Half a radian is ten times what any effect of the catalogue turns a tool.
    most_turned: float = 0.5
    # m between a marker's fiducials at most: an orientation is no better than the position's noise over it.
    marker_size: float = 0.1


@dataclass(frozen=True)
class TestSettings:
    """Small tests of the residual."""

    # Bootstrap samples of the null law, whose moments give its quantile.
    draws: int = 60
    # Quantile of the largest of all tests in noise that a finding must beat. Asked for by the design of the method.
    level: float = 0.99
    # Of a cell's mean, in root mean squares of the residual: hardly any shrinkage.
    prior_std: float = 3.0
    # Whitened residuals beyond count as this.
    clip: float = 5.0
    # Nats of a tone: a chance below 1e-5 in noise of a smooth spectrum (Chernoff).
    sure_tone: float = 12.0
    # Of the noise: a systematic part below it does not matter. Asked for by the design of the method.
    equivalence: float = 0.25
    # Of a joint's travel: smaller moves do not turn its direction.
    resolution: float = 1e-3
    # Of a channel. Asked for by the design of the method.
    max_tests: int = 150


@dataclass(frozen=True)
class BurstSettings:
    """What happens too rarely to be learned in some motions and seen again in others."""

    # Noise levels of a trajectory: above, something happens in it. In 36 recordings of either truth without an effect
    # no trajectory has more than 1.5 of white noise, nor more than 2.5 of slow noise.
    limit: float = 3.0
    # Noise levels of the trajectory in the middle: above, it is not rare. In the same recordings 1.4 at most.
    calm: float = 1.25
    # Into which what happens once is cut, so that most of them can foretell the others.
    pieces: int = 10
    # Condensed rows of a piece at least: noise is whitened inside of each.
    shortest: int = 3
    # Of a signature's energy that must lie where it happens: what acts elsewhere as well is evident from motion to
    # motion.
    there: float = 0.8


@dataclass(frozen=True)
class SearchSettings:
    """Which effects are looked for, and when one is added."""

    # Of the noise: a signature below leaves no trace.
    trace: float = 0.02
    # Probability that any effect at all is added, before it is divided among the candidates. Asked for by the design of
    # the method.
    prior: float = 0.01
    # Nats that each parameter beyond an effect's first must bring: limits of one effect are not another.
    complexity: float = 4.0
    # Effects that are refitted with a new one. For time.
    free_together: int = 8
    # Motions before and after an instant: one alone may be odd for a reason of its own.
    watched: int = 2
    # Of a bound: a number this near to it is at the edge of its physical range.
    edge: float = 0.01
    # Of the search, at most one effect a joint in each. Asked for by the design of the method.
    rounds: int = 4
    # Leaders that are refined before one is chosen. For time.
    refined: int = 2
    # Leaders tried for that many whose numbers stay physical. For time.
    looked_at: int = 4
    # Of the leader's nats: below, a candidate is not worth refining.
    near_leader: float = 0.3


@dataclass(frozen=True)
class NamingSettings:
    """When an effect may be named."""

    # Posterior of an exact name. Asked for by the design of the method.
    exact: float = 0.95
    # Posterior above which a rival cannot be ruled out: what EXACT leaves.
    stable: float = 0.05
    # Of an effect's nats, found beside it by the smooth model: then that model competes in full.
    unknown_fraction: float = 0.25
    # Nats from which an effect with a small remainder stands against any smooth model.
    strong: float = 30.0
    # Of a signature, relative: how well an operator describes the real thing.
    shape_error: float = 0.03
    # Of a number: none is known better, for masses and lengths of a machine's file are hardly known to a thousandth.
    finest: float = 1e-3
    # Of a signature, squared, that an effect may lack to count as the more general one: an error of the first row of a
    # table also turns gravity a little, 0.02 of it on a development case. Their evidence decides.
    general: float = 0.1
    # Names that are refined in each effect's place, beside its simpler look-alikes. For time.
    rivals: int = 2
    # Candidates looked at for likeness. For time.
    tried: int = 8
    # Cosine of two signatures, beyond what the others explain, below which they are no rivals.
    likeness: float = 0.5
    # Of the strongest trajectory's energy: below, one says nothing of a size.
    active: float = 0.01
    # Channels of the smooth model, those in which an effect shows most. For time.
    smooth_channels: int = 3
    # Strongest pairs of variables of a channel in the smooth model. For time.
    smooth_pairs: int = 3
    # Nats behind an effect, from which on a rival is fitted no further: it is less probable than one in a thousand.
    hopeless: float = 7.0
    # Searches for what the effects taken out had stood in for.
    searches: int = 2
    # Of each of them.
    search_rounds: int = 2
    # Nats of an effect that leaves a hole when it goes.
    hole: float = 30.0
    # Of the mean square above noise, that must close where an effect shows.
    least_closed: float = 0.4
    # Noise levels: a rest below may be noise.
    plain_rest: float = 1.25
    # Of the noise, squared, by which a channel's mean square may grow by chance: five standard deviations of the mean
    # over 5000 rows of white noise.
    worse: float = 0.1
    # Of an effect's own nats: with more in its overtones it is a part of something else.
    most_overtones: float = 0.25
    # Nats on the confirmation part: odds of twenty to one.
    confirmed: float = 3.0
    # Of the trajectories in which an effect acts, that it must help. Asked for by the design of the method.
    positive_fraction: float = 0.6
    # Trajectories in which it acts: fewer may be odd for a reason of their own.
    few: int = 3
    # Of a signature by the others: not nameable, where the rest is less than an error in our own signatures could make
    # of the others (`shape_error`), or brings fewer nats than `strong`. Asked for by the design of the method.
    explained: float = 0.95
    # Of its range, that the 95 % interval of a shape's number may be wide: a uniform prior cut to a third has brought
    # at least one nat, and a wave's number is known to a factor of four.
    determined: float = 1.0 / 3.0


@dataclass(frozen=True)
class SensorSettings:
    """When noise itself has a name."""

    # Second differences of a trajectory: fewer say too little of its level.
    fewest: int = 60
    # Trajectories on either side of a change.
    side: int = 2
    # Robust standard deviations: what is farther out is a fault.
    trim: float = 5.0
    # Chance of a change in noise that does not change, shared by the channels. A definition.
    chance: float = 1e-3
    # Of the logarithm of the level: a smaller change is none.
    least_change: float = 0.02
    # Times the stated level.
    beyond: float = 1.2
    # Of the trajectories, that must be beyond it.
    nearly: float = 0.9
    # Of the outside sensors' noise: rounding by less is no discrepancy.
    rounding_matters: float = 0.1
    # Times the stated encoder step.
    coarser: float = 2.0
    # Counts visited by an encoder: fewer show no step.
    fewest_counts: int = 8
    # Length of the mean of unit vectors at the remainders' angles.
    agreement: float = 0.97


@dataclass(frozen=True)
class VerdictSettings:
    """What a run comes to."""

    # Of the noise: a systematic part larger than the noise itself, left at one joint, is the headline whatever is named
    # at another. A definition.
    rest: float = 1.0
    # Of the noise: more of it put down to tolerances may hide what is missing.
    most_tolerated: float = 0.5
    # Thresholds of the tests: a finding above them is beyond doubt.
    plain: float = 3.0
    # Of a finding's nats, that an unnamed effect may have gained, and the finding stay unexplained.
    explained: float = 0.5


@dataclass(frozen=True)
class AdviceSettings:
    """What is worth recording next."""

    # Nats: below, two effects are equivalent with these sensors. Asked for by the design of the method.
    enough: float = 3.0
    # Posterior from which on an alternative is worth an experiment.
    open_probability: float = 0.01


@dataclass(frozen=True)
class DiscrepancySettings:
    """All of them, by what they decide."""

    split: SplitSettings = SplitSettings()
    noise: NoiseSettings = NoiseSettings()
    tests: TestSettings = TestSettings()
    bursts: BurstSettings = BurstSettings()
    search: SearchSettings = SearchSettings()
    naming: NamingSettings = NamingSettings()
    sensors: SensorSettings = SensorSettings()
    verdict: VerdictSettings = VerdictSettings()
    advice: AdviceSettings = AdviceSettings()


SETTINGS = DiscrepancySettings()
SPLIT = SETTINGS.split
NOISE = SETTINGS.noise
TESTS = SETTINGS.tests
BURSTS = SETTINGS.bursts
SEARCH = SETTINGS.search
NAMING = SETTINGS.naming
SENSORS = SETTINGS.sensors
VERDICT = SETTINGS.verdict
ADVICE = SETTINGS.advice
