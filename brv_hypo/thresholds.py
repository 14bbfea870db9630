"""What decides a fault of a flight record: every threshold with its unit, what it decides, and what set it.

A threshold is a plain number where it is used; its entry in `THRESHOLDS` says the rest, and `source` names the paper,
the study (`python -m ...`) or the test file of this repository that set it or holds with it. "Judgement" stands where
nothing but experience did. Numerics that decide nothing (step widths, orders of a fit, sizes in memory) stand beside
their code.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

Number = TypeVar("Number", int, float, tuple[float, float], tuple[float, float, float])


@dataclass(frozen=True)
class Threshold:
    """One entry of the table."""

    value: float | tuple[float, ...]
    """The number, in `unit`."""
    unit: str
    """Unit, or what the number counts; "1" of a ratio."""
    decides: str
    """What is concluded where the threshold is crossed."""
    source: str
    """Paper, study or test that set it."""


THRESHOLDS: list[Threshold] = []


def threshold(value: Number, *, unit: str, decides: str, source: str) -> Number:
    """`value` as it is, entered in `THRESHOLDS`."""
    THRESHOLDS.append(Threshold(value, unit, decides, source))
    return value

# Sources that several thresholds share.
_TRIAL_STUDY = "tests/motion/test_trial.py and tests.studies.independent.faulty_records"
_FAULT_STUDIES = "tests.studies.record_faults and tests.studies.independent.faulty_records"
_JUDGEMENT_AND_STUDY = "judgement; held by tests/flight/test_faults.py and tests.studies.independent.faulty_records"
_GAP_STUDY = "tests/flight/test_gaps.py and tests.studies.independent.faulty_records"
_SPIKE_STUDY = "tests/flight/test_spikes.py and tests.studies.independent.faulty_records"
_LIMIT_TESTS = "tests/motion/test_limits.py"
_FORMAT_TESTS = "judgement; tests/flight/test_store.py"
_ANSWERABLE_TESTS = "judgement; tests/motion/test_answerable.py"

# ---- Trial of the record, channel by channel: clock, stuck, spikes, bursts, gaps ----

CLOCK_MOST_STEPS = threshold(
    5,
    unit="intervals",
    decides="that many odd intervals, or fewer, are clock steps and not jitter or dropouts",
    source=_FAULT_STUDIES,
)
CLOCK_RUNS_ON = threshold(
    2.0,
    unit="noise variances",
    decides="the samples are continuous with the interval closed: the clock stepped",
    source=_FAULT_STUDIES,
)
CLOCK_FAR_BETTER = threshold(
    0.01,
    unit="1",
    decides="or continuous relative to the misfit with the interval as stamped",
    source="tests.studies.independent.faulty_records",
)
CLOCK_WORST_CHANNEL = threshold(
    2.0,
    unit="1",
    decides="how much of the mean misfit any one channel may have for a clock step",
    source=_FAULT_STUDIES,
)
CLOCK_FEWEST_MOVED = threshold(
    2,
    unit="channels",
    decides="whether enough channels would have moved to call an odd interval a clock step",
    source=_FAULT_STUDIES,
)
CLOCK_MOVED_SIGMAS = threshold(
    8.0,
    unit="standard deviations of the noise",
    decides="a channel would have moved in the time of the interval",
    source=_FAULT_STUDIES,
)
CLOCK_SLOPE_SIGMAS = threshold(
    5.0,
    unit="standard errors",
    decides="the trend of a channel is known well enough for that",
    source=_FAULT_STUDIES,
)
JUMP_SIGMAS = threshold(
    12.0,
    unit="robust standard deviations",
    decides="gyros and accelerometers jump together: decisive clock step",
    source=_FAULT_STUDIES,
)
JUMP_TIMES_AROUND = threshold(
    3.0, unit="1", decides="such a jump stands above the misses of parabolas around it", source=_FAULT_STUDIES
)
STUCK_FEWEST_SAMPLES = threshold(
    50,
    unit="samples",
    decides="a channel is long enough to be called stuck or clipped",
    source=_JUDGEMENT_AND_STUDY,
)
STUCK_REPEATS_SELDOM = threshold(
    0.02,
    unit="1",
    decides="a channel does not repeat itself by nature (share of repeated samples)",
    source=_JUDGEMENT_AND_STUDY,
)
STUCK_LEAST_SHARE = threshold(
    1e-3,
    unit="1",
    decides="least share of repeated samples assumed: how short a run may be that counts",
    source=_JUDGEMENT_AND_STUDY,
)
STUCK_CHANCE = threshold(
    1e-6, unit="1", decides="a run of constants is no chance: stuck", source=_JUDGEMENT_AND_STUDY
)
STUCK_RELEASE = threshold(
    5.0,
    unit="largest common steps",
    decides="a channel that repeats itself is stuck: the jump that ends the run",
    source=_JUDGEMENT_AND_STUDY,
)
FLAT_RUN = threshold(
    3,
    unit="samples",
    decides="a flat top: samples at the extreme value in succession",
    source=_JUDGEMENT_AND_STUDY,
)
FLAT_SAMPLES = threshold(
    5, unit="samples", decides="a flat top: samples at the extreme value in all", source=_JUDGEMENT_AND_STUDY
)
FLAT_TIMES = threshold(
    5.0,
    unit="1",
    decides="a flat top of a quantised channel, over the samples of any level next to it",
    source=_JUDGEMENT_AND_STUDY,
)
MOST_CLIPPED = threshold(
    0.05,
    unit="1",
    decides="a clipped channel is decisive instead of masked (share of samples)",
    source=_JUDGEMENT_AND_STUDY,
)
MOST_STUCK = threshold(
    0.5,
    unit="1",
    decides="a stuck channel is decisive instead of masked (share of samples)",
    source=_JUDGEMENT_AND_STUDY,
)
DEAD_NOISE = threshold(
    1e-9,
    unit="1",
    decides="another instrument is live: its noise over its greatest value",
    source=_JUDGEMENT_AND_STUDY,
)
DEAD_CHANGE = threshold(
    0.02,
    unit="1",
    decides="a constant gauge is dead: relative change of the speed that it missed",
    source=_JUDGEMENT_AND_STUDY,
)
DEAD_PUSH = threshold(
    2.0,
    unit="1",
    decides="a constant speed is dead: change that the axial force makes, over DEAD_CHANGE",
    source=_JUDGEMENT_AND_STUDY,
)
SPIKE_SIGMAS = threshold(
    8.0, unit="robust standard deviations", decides="a run of samples is a spike", source=_SPIKE_STUDY
)
SPIKE_TIMES_CURVATURE = threshold(
    2.0, unit="1", decides="a run is a spike, over the largest second difference around", source=_SPIKE_STUDY
)
SPIKE_TIMES_FOURTH = threshold(
    2.5, unit="1", decides="or over the largest fourth difference around", source=_SPIKE_STUDY
)
SPIKE_LONGEST = threshold(
    2, unit="samples", decides="longest run that is an isolated spike", source=_SPIKE_STUDY
)
SPIKE_LARGEST_FRACTION = threshold(
    0.02, unit="1", decides="more spikes than this share of a channel are its noise", source=_SPIKE_STUDY
)
BURST_SHORTEST = threshold(
    3, unit="samples", decides="shortest run that is a burst of spikes", source=_FAULT_STUDIES
)
BURST_LONGEST = threshold(
    60, unit="samples", decides="longest run that is a burst of spikes", source=_FAULT_STUDIES
)
BURST_SIGMAS = threshold(
    8.0,
    unit="robust standard deviations",
    decides="a burst: its edges, and its departure from the quintic",
    source=_FAULT_STUDIES,
)
BURST_TIMES_AROUND = threshold(
    3.0, unit="1", decides="an edge of a burst, over the third differences around", source=_FAULT_STUDIES
)
BURST_EDGE_OCTAVES = threshold(
    1.0, unit="octaves", decides="the edges of a burst are the steps to its departure", source=_FAULT_STUDIES
)
BURST_LARGEST_FRACTION = threshold(
    0.05, unit="1", decides="more bursts than this share of a channel are its nature", source=_FAULT_STUDIES
)
BURST_MOST_EDGES = threshold(
    200, unit="edges", decides="more edges in a channel are its nature", source=_FAULT_STUDIES
)
UNIFORM_WITHIN = threshold(
    0.01, unit="sample intervals", decides="stamps are uniform; an interval is odd", source=_GAP_STUDY
)
MISSING_BEYOND_STEPS = threshold(
    1.5, unit="sample intervals", decides="samples are missing between two stamps", source=_GAP_STUDY
)
GAP_BEYOND_MEDIANS = threshold(
    2.5,
    unit="median intervals",
    decides="an interval is a gap, and counts for no mean step",
    source=_GAP_STUDY,
)
LARGEST_GROWTH = threshold(
    50,
    unit="1",
    decides="stamps are refused: samples of an even grid over samples recorded",
    source=_GAP_STUDY,
)
BRIDGED_SAMPLES = threshold(
    5, unit="samples", decides="a gap in rates and forces is bridged instead of cut", source=_GAP_STUDY
)
BRIDGED_CYCLES = threshold(
    1.0 / 8.0, unit="cycles of the transverse motion", decides="or is so short: bridged, not cut", source=_GAP_STUDY
)
BRIDGED_SECONDS = threshold(
    1.0, unit="s", decides="a gap in the air data is bridged instead of cut", source=_GAP_STUDY
)
PRESSURE_CONSISTENT = threshold(
    0.05,
    unit="1",
    decides="recorded dynamic pressure contradicts density and velocity: a note",
    source="judgement; tests/flight/test_derive.py",
)

# ---- Trial of the record: gyros against accelerometers against air data ----

FASTEST_RATE = threshold(
    1e3, unit="rad/s", decides="the gyros are in wrong units: the record is refused", source=_ANSWERABLE_TESTS
)
LARGEST_MOMENT = threshold(
    1.0,
    unit="1",
    decides="moment coefficient of no vehicle: with LEAST_SWING, the air is too thin to answer",
    source=_ANSWERABLE_TESTS,
)
LEAST_SWING = threshold(
    1e-3,
    unit="1",
    decides="the air is too thin: change of the rates by the largest moment over their own change",
    source=_ANSWERABLE_TESTS,
)
COMPATIBILITY_KEPT = threshold(
    (0.002, 0.1, 0.1),
    unit="1",
    decides="a relation counts as kept: share of it that is unexplained, by relation",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_TOO_NOISY = threshold(
    0.3, unit="1", decides="a relation says nothing: share of it that is noise", source=_TRIAL_STUDY
)
COMPATIBILITY_NORMAL_SLOPE = threshold(
    1.2,
    unit="1/rad",
    decides="normal-force slope of any body, from which a found slope is judged",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_NORMAL_SPREAD = threshold(
    1.3, unit="1", decides="1-sigma of the logarithm of that slope among bodies", source=_TRIAL_STUDY
)
COMPATIBILITY_WIND = threshold(
    10.0,
    unit="m/s",
    decides="1-sigma of the wind along the path, which may explain a deceleration",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_WIND_TOLERANCES = threshold(
    2.0,
    unit="standard deviations",
    decides="the same in tolerances of the flight, where that is more",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_AXIAL_SPREAD = threshold(
    0.25,
    unit="1",
    decides="1-sigma of the logarithm of true over sensed deceleration of a sound record",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_DENSITY_SPREAD = threshold(
    0.35, unit="1", decides="1-sigma of the logarithm of the density of the day", source=_TRIAL_STUDY
)
COMPATIBILITY_NOISE_SPREAD = threshold(
    0.5,
    unit="1",
    decides="1-sigma of the logarithm of noise among three instruments of one make",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_STEADY = threshold(
    3.0,
    unit="1",
    decides="a constant transverse force counts against a correction: size over what oscillates",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_FURTHER_MISTAKE = threshold(
    1.5,
    unit="ln likelihood",
    decides="each further mistake in one record is less likely",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_BROKEN = threshold(
    0.012, unit="1", decides="relation 1 is broken: unexplained share beyond the noise", source=_TRIAL_STUDY
)
COMPATIBILITY_TIMES_NOISE = threshold(
    4.0, unit="1", decides="noise counts so many times before a share is unexplained", source=_TRIAL_STUDY
)
COMPATIBILITY_STRAINED = threshold(
    0.003, unit="1", decides="relation 1 is strained: unexplained share beyond the noise", source=_TRIAL_STUDY
)
COMPATIBILITY_BROKEN_ALONE = threshold(
    0.7,
    unit="1",
    decides="gyros contradict themselves where accelerometers say nothing: unexplained share",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_AXIAL_WITHIN = threshold(
    (0.5, 2.0),
    unit="1",
    decides="the axial accelerometer or the speed is wrong: true over sensed deceleration",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_AXIAL_SIGMAS = threshold(
    3.0, unit="standard errors", decides="the same: certainty of that ratio", source=_TRIAL_STUDY
)
COMPATIBILITY_PRESSURE_WITHIN = threshold(
    (0.3, 3.0),
    unit="1",
    decides="dynamic pressure or altitude is wrong: density over that of the standard atmosphere",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_NORMAL_WITHIN = threshold(
    (0.04, 30.0),
    unit="1/rad",
    decides="accelerometers or pressure are wrong: slope of the normal force",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_DECISIVE = threshold(
    2.2,
    unit="ln likelihood",
    decides="a mistake of sign, axis or unit is named: gain by undoing it",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_DECISIVE_IF_STRAINED = threshold(
    4.5,
    unit="ln likelihood",
    decides="the same, of a record that is strained but not broken",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_CORRECTED = threshold(
    0.4,
    unit="1",
    decides="a correction restores a broken relation: share of it that it leaves",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_NEARLY_EQUAL = threshold(
    1.0, unit="ln likelihood", decides="another correction is named beside the best", source=_TRIAL_STUDY
)
COMPATIBILITY_UNRELATED = threshold(
    0.5,
    unit="1",
    decides="gyros and accelerometers belong to no one motion: unexplained share of each relation",
    source=_TRIAL_STUDY,
)
COMPATIBILITY_QUIET = threshold(
    0.1, unit="1", decides="noise is small enough to say so: its share of a relation", source=_TRIAL_STUDY
)

# ---- Motion: filters, smoothing, the fit of forces and rates ----

WARNED_PER_CYCLE = threshold(
    20.0,
    unit="samples",
    decides="warning: too few samples in a cycle of the transverse motion; status degraded",
    source=_LIMIT_TESTS,
)
WARNED_ALPHA = threshold(
    0.1, unit="1", decides="warning: sigma of alpha over its rms; status degraded", source=_LIMIT_TESTS
)
WARNED_MOMENTS = threshold(
    0.2,
    unit="1",
    decides="warning: noise of the moments over their rms; status degraded",
    source=_LIMIT_TESTS,
)
WARNED_GRAVITY = threshold(
    2.0,
    unit="1",
    decides="warning: gravity found over gravity expected; status degraded",
    source=_LIMIT_TESTS,
)

# ---- Format of a record ----

MINIMUM_SAMPLES = threshold(
    16, unit="samples", decides="a record, or a segment of it, is too short to use", source=_FORMAT_TESTS
)
SLOWEST = threshold(
    0.1,
    unit="m/s",
    decides="a slower vehicle is at rest and its sample is refused: coefficients are per speed and dynamic pressure",
    source=_FORMAT_TESTS,
)
SHORTEST_STEP = threshold(
    1e-7,
    unit="s",
    decides="time is in a larger unit than stated and the record is refused",
    source=_FORMAT_TESTS,
)
LARGEST_PROPERTY = threshold(
    1e9,
    unit="SI",
    decides="a property of the vehicle is a fill value (its inverse is the least value)",
    source=_FORMAT_TESTS,
)
LEAST_SEGMENT_SAMPLES = threshold(
    16,
    unit="samples",
    decides="the longest segment is too short to be integrated and the record is refused",
    source="tests/motion/test_answerable.py",
)
