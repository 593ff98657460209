"""The rules by which the gap workflow decides, as every artefact states them.

`RULES` are those of any system; a system that decides otherwise has its own.
"""

import itertools
import math
from dataclasses import dataclass
from statistics import NormalDist

_SEALED, _MOST_SEALED = {1: 0, 2: 0, 3: 0, 4: 1, 5: 1}, 2


@dataclass(frozen=True)
class Rules:
    """What an effect must show to be named; gains are in nats of held-out log density.

    Attributes:
        false_alarms: Share of recordings without any missing effect in which one may be named.
        steady_alarms: The part of these in which an effect may be named because it gains in block
            after block.
        false_discoveries: Share of the reported places that noise alone may have made.
        forbids_none_q: A place of this q value or below speaks against "nothing is missing"; one
            in fifty recordings has it by chance.
        white_quantile: Share of recordings of white noise that pass as white.
        least_nats: Nothing is named for less, however little chance brings.
        speaks_nats: Sealed recordings that gain less say nothing about an effect.
        sure_share: Share of the recordings in which an effect has to be found for it to count as
            one that such recordings show.
        bent_sd: A constant this many standard deviations from its stated value is reported, and
            what was found beside it doubted; of twenty constants, chance bends one as far in one
            case of twenty.
        class_nats: Rivals within this of the best cannot be told from it: odds of 1 to 20.
        companion_share: Share of what an effect gains without another that it gains beside it if it
            is no rival of that one: each explains something else.
        most_in_class: More rivals than these are no class; the answer is then unknown.
        least_share: Share of the squared error of forecasts that an effect removes to matter.
        least_of_gap: Share of the squared error that there was at first which a further effect
            removes to matter.
        first_times: An effect that surely removes this many times as much of the squared error as
            another comes before it, although that one gains more nats.
        simpler_share: Share of the best's gain that a simpler effect needs to be named instead, and
            an effect of the library to keep its name beside a formula.
        unexplained_share: An effect that is not named and removes more than this share of the
            squared error shows that something unknown is missing.
        unknown_push: Share of a rate from which a lasting push that nothing explains is something
            unknown, whatever it follows: the model then knows less than two thirds of what acts.
        surely_share: An effect that surely removes more than this share of the squared error is
            named, also where forecasts that ask no model are better than those with it, and where
            loud moments or a single block might have brought what it gains.
        most_effects: More than these are not named in one answer. A kind at several ports alike
            counts once: a robot with four motors has four lags.
        most_named: Nor more than these, however alike.
        readings_ahead: Of a forecast's readings, those that are looked at where a system is asked
            to predict far ahead.
        far_less: An effect with which inputs do no more than this share of what the system says is
            doubted, as is that it forecasts better: where a controller gives the inputs, a force
            that it holds against looks alike.
        hardly_anything: With an effect by which inputs do no more than this share, others that gain
            a good part of what it does make a class.
        interval_quantile: Where the ends of intervals of gains and sizes lie, of what chance brings
            to one side: 90 % lie between both.
        fewest_blocks: Gains in fewer blocks than this have a spread that says nothing.
        plain_times: An effect that gains this many times what chance brings is needed by any
            account, and no longer tried against the answer without it.
        port_share: Share of what a kind gains at one port that it needs at ports alike to be asked
            for there, too.
        far_stretch: A stretch of forecasts counts for no more than this many typical ones: from an
            unstable state all models run away.
        fewest_far: Stretches that err by more than `far_stretch` count in full where there are at
            least this many, and an effect halves the error of each.
        far_lost_share: They do not where the other stretches lose more than this share of what
            these gain.
        push_share: A lasting push above this share of the usual rate is reported; any model's form
            may be off by as much.
        push_ln_sd: The logarithm of its size is known better than to this, or it surely is above
            `unknown_push`.
        followed_share: Share of a push's variance that a coordinate explains, for the push to
            follow it.
        late_nats: Outputs that move before their input does have to say so by this much, and more
            than any delay does; chance brings none.
        hides_nats: A candidate that is not named and gains more is reported as what a calibration
            may hide: about half of what a constant hides that has moved by three spreads.
        error_trifle: Share by which an output's error may change without being worth a word.
        constant_ends: A constant is reported as other than stated where its stated value is this
            many times as far from the fitted one as the end of its interval,
        constant_trifle: and by more than this share of it.
        sealed_share: Share of the blocks of a system's logs, or of those that move, that is kept to
            confirm what was found in the others.
        fewest_flights: Episodes that a verdict is fitted to, at least; of two, each would be judged
            by one other, and their spread by one number.
    """

    false_alarms: float = 0.05
    steady_alarms: float = 0.01
    false_discoveries: float = 0.05
    forbids_none_q: float = 0.02
    white_quantile: float = 0.999
    least_nats: float = 3.0
    speaks_nats: float = 3.0
    class_nats: float = 3.0
    sure_share: float = 0.8
    bent_sd: float = 3.0
    companion_share: float = 0.5
    most_in_class: int = 3
    least_share: float = 0.01
    least_of_gap: float = 0.001
    first_times: float = 2.0
    simpler_share: float = 0.8
    unexplained_share: float = 0.1
    unknown_push: float = 0.5
    surely_share: float = 0.5
    most_effects: int = 4
    most_named: int = 8
    readings_ahead: int = 6
    far_less: float = 2.0 / 3.0
    hardly_anything: float = 1.0 / 3.0
    interval_quantile: float = 0.95
    fewest_blocks: int = 6
    plain_times: float = 5.0
    port_share: float = 0.5
    far_stretch: float = 20.0
    fewest_far: int = 3
    far_lost_share: float = 0.1
    push_share: float = 0.05
    push_ln_sd: float = 0.5
    followed_share: float = 0.1
    late_nats: float = 10.0
    hides_nats: float = 2.0
    error_trifle: float = 0.05
    constant_ends: float = 2.0
    constant_trifle: float = 0.02
    sealed_share: float = 0.25
    fewest_flights: int = 3

    @property
    def margin_nats(self) -> float:
        """A mean gain of which more than `class_nats` are left in `sure_share` of recordings."""
        return surely_nats(self.class_nats, self.sure_share)


def surely_nats(wanted: float, share: float = Rules.sure_share) -> float:
    """The mean gain that leaves at least `wanted` nats in this share of recordings.

    A gain of L nats scatters by √(2 L) from one to the next (Kay, Fundamentals of Statistical
    Signal Processing II, 1998, ch. 6).
    """
    half = NormalDist().inv_cdf(share) / math.sqrt(2.0)
    return (half + math.sqrt(half**2 + wanted)) ** 2


RULES = Rules()


def sealed_count(flights: int) -> int:
    """How many of `flights` flights, the last ones, are sealed to show the gap on.

    None of three: two would be too few to find anything in. Each is then left out in turn.
    """
    return _SEALED.get(flights, _MOST_SEALED)


# Enough to fit to, and one beside them that confirms what was found in those.
FEWEST_IN_ALL = next(
    n for n in itertools.count(1) if sealed_count(n) and n - sealed_count(n) >= RULES.fewest_flights
)
