"""Thresholds that decide whether a record is faulty, a mechanism named or an effect found: value, unit, source.

A threshold is a plain number where it is used; its entry in `THRESHOLDS` says the rest, and `source` names the paper,
the study (`python -m ...`) or the test file of this repository that set it or holds with it. "Judgement" is where
nothing but experience did. Numerics that decide nothing (step widths, orders of a fit, sizes in memory) are beside
their code, and are judgement too where they name no source.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

Number = TypeVar("Number", int, float, tuple[float, float], tuple[float, float, float])


@dataclass(frozen=True)
class Threshold:
    """One entry of the table."""

    value: float | tuple[float, ...]  # the number, in `unit`
    unit: str  # or what the number counts; "1" of a ratio
    decides: str  # what is concluded where the threshold is crossed
    source: str  # paper, study or test that set it


THRESHOLDS: list[Threshold] = []


def threshold(value: Number, unit: str, decides: str, source: str) -> Number:
    """`value` as it is, entered in `THRESHOLDS`."""
    THRESHOLDS.append(Threshold(value, unit, decides, source))
    return value


# Sources that several thresholds share.
_TRIAL = "tests/motion/test_trial.py and tests.studies.independent.faulty_records"
_FAULTS = "tests.studies.record_faults and tests.studies.independent.faulty_records"
_HELD = "judgement; held by tests/flight/test_faults.py and tests.studies.independent.faulty_records"
_STEPS = "judgement; tests/importing/test_soundness.py"
_GAPS = "tests/flight/test_gaps.py and tests.studies.independent.faulty_records"
_SPIKES = "tests/flight/test_spikes.py and tests.studies.independent.faulty_records"
_LIMITS = "tests/motion/test_limits.py"
_GROSS = "tests/motion/test_answerable.py"
_FORMAT = "judgement; tests/flight/test_store.py"
_FAULTY = "tests.studies.independent.faulty_records"
_USABLE = "judgement; tests/motion/test_answerable.py"
_JOINT = "judgement; tests.studies.independent.joint --apart"

# ---- Trial of the record, channel by channel: clock, stuck, spikes, bursts, gaps ----

CLOCK_MOST_STEPS = threshold(5, "intervals", "so many odd intervals, or fewer, are clock steps", _FAULTS)
CLOCK_RUNS_ON = threshold(2.0, "noise variances", "continuous with the interval closed: the clock stepped", _FAULTS)
CLOCK_FAR_BETTER = threshold(0.01, "1", "or continuous relative to the misfit as stamped", _FAULTY)
CLOCK_WORST_CHANNEL = threshold(2.0, "1", "part of the mean misfit that one channel may have", _FAULTS)
CLOCK_FEWEST_MOVED = threshold(2, "channels", "channels that a clock step would have moved", _FAULTS)
CLOCK_MOVED_SIGMAS = threshold(8.0, "noise sigmas", "a channel would have moved in the time of the interval", _FAULTS)
CLOCK_SLOPE_SIGMAS = threshold(5.0, "sigmas", "the trend of a channel is known well enough for that", _FAULTS)
JUMP_SIGMAS = threshold(12.0, "robust sigmas", "gyros and accelerometers jump together: decisive clock step", _FAULTS)
JUMP_EXPLAINED = threshold(0.6, "1", "share of all channels' jumps that one step of the clock makes", _FAULTS)
JUMP_TIMES_AROUND = threshold(3.0, "1", "such a jump stands above the misses of parabolas around it", _FAULTS)
STUCK_FEWEST_SAMPLES = threshold(50, "samples", "a channel is long enough to be called stuck or clipped", _HELD)
STUCK_REPEATS_SELDOM = threshold(0.02, "1", "a channel does not repeat itself by nature (repeated share)", _HELD)
STUCK_LEAST_SHARE = threshold(1e-3, "1", "least share of repeats assumed: how short a run counts", _HELD)
STUCK_CHANCE = threshold(1e-6, "1", "a run of constants is no chance: stuck", _HELD)
STUCK_RELEASE = threshold(5.0, "largest common steps", "a repetitive channel is stuck: jump that ends the run", _HELD)
FLAT_RUN = threshold(3, "samples", "a flat top: samples at the extreme value in succession", _HELD)
FLAT_SAMPLES = threshold(5, "samples", "a flat top: samples at the extreme value in all", _HELD)
FLAT_TIMES = threshold(5.0, "1", "a flat top of a quantised channel, over the samples of any level next to it", _HELD)
MOST_CLIPPED = threshold(0.05, "1", "a clipped channel is decisive instead of masked (share of samples)", _HELD)
MOST_STUCK = threshold(0.5, "1", "a stuck channel is decisive instead of masked (share of samples)", _HELD)
DEAD_NOISE = threshold(1e-9, "1", "another instrument is live: its noise over its greatest value", _HELD)
DEAD_CHANGE = threshold(0.02, "1", "a constant gauge is dead: relative change of the speed that it missed", _HELD)
DEAD_PUSH = threshold(2.0, "1", "a constant speed is dead: change that the axial force makes, over DEAD_CHANGE", _HELD)
SPIKE_SIGMAS = threshold(8.0, "robust sigmas", "a run of samples is a spike", _SPIKES)
SPIKE_TIMES_CURVATURE = threshold(2.0, "1", "a run is a spike, over the largest second difference around", _SPIKES)
SPIKE_TIMES_FOURTH = threshold(2.5, "1", "or over the largest fourth difference around", _SPIKES)
SPIKE_LONGEST = threshold(2, "samples", "longest run that is an isolated spike", _SPIKES)
SPIKE_LARGEST_FRACTION = threshold(0.02, "1", "more spikes than this share of a channel are its noise", _SPIKES)
BURST_SHORTEST = threshold(3, "samples", "shortest run that is a burst of spikes", _FAULTS)
BURST_LONGEST = threshold(60, "samples", "longest run that is a burst of spikes", _FAULTS)
BURST_SIGMAS = threshold(8.0, "robust sigmas", "a burst: its edges, and its departure from the quintic", _FAULTS)
BURST_TIMES_AROUND = threshold(3.0, "1", "an edge of a burst, over the third differences around", _FAULTS)
BURST_EDGE_OCTAVES = threshold(1.0, "octaves", "the edges of a burst are the steps to its departure", _FAULTS)
BURST_LARGEST_FRACTION = threshold(0.05, "1", "more bursts than this share of a channel are its nature", _FAULTS)
BURST_MOST_EDGES = threshold(200, "edges", "more edges in a channel are its nature", _FAULTS)
UNIFORM_WITHIN = threshold(0.01, "sample intervals", "stamps are uniform; an interval is odd", _GAPS)
MISSING_BEYOND_STEPS = threshold(1.5, "sample intervals", "samples are missing between two stamps", _GAPS)
GAP_BEYOND_MEDIANS = threshold(2.5, "median intervals", "an interval is a gap, and counts for no mean step", _GAPS)
LARGEST_GROWTH = threshold(50, "1", "stamps are refused: samples of an even grid over samples recorded", _GAPS)
BRIDGED_SAMPLES = threshold(5, "samples", "a gap in rates and forces is bridged instead of cut", _GAPS)
BRIDGED_CYCLES = threshold(1.0 / 8.0, "cycles of the transverse motion", "or is so short: bridged, not cut", _GAPS)
BRIDGED_SECONDS = threshold(1.0, "s", "a gap in the air data is bridged instead of cut", _GAPS)
PRESSURE_CONSISTENT = threshold(0.05, "1", "pressure contradicts density and speed", "tests/flight/test_derive.py")

# ---- Trial of the record: gyros against accelerometers against air data ----

FASTEST_RATE = threshold(1e3, "rad/s", "the gyros are in wrong units: the record is refused", _USABLE)
LARGEST_MOMENT = threshold(1.0, "1", "moment coefficient of no vehicle: the air is too thin", _USABLE)
LEAST_SWING = threshold(1e-3, "1", "change of rates by that moment over their own", _USABLE)
COMPATIBILITY_KEPT = threshold((0.002, 0.1, 0.1), "1", "a relation is kept: unexplained share, by relation", _TRIAL)
COMPATIBILITY_TOO_NOISY = threshold(0.3, "1", "a relation says nothing: share of it that is noise", _TRIAL)
COMPATIBILITY_NORMAL_SLOPE = threshold(1.2, "1/rad", "normal-force slope of any body", _TRIAL)
COMPATIBILITY_NORMAL_SPREAD = threshold(1.3, "1", "1-sigma of the logarithm of that slope among bodies", _TRIAL)
COMPATIBILITY_WIND = threshold(10.0, "m/s", "sigma of the wind along the path, which may decelerate", _TRIAL)
COMPATIBILITY_WIND_TOLERANCES = threshold(2.0, "sigmas", "the same in tolerances, where that is more", _TRIAL)
COMPATIBILITY_AXIAL_SPREAD = threshold(0.25, "1", "log sigma of true over sensed deceleration", _TRIAL)
COMPATIBILITY_DENSITY_SPREAD = threshold(0.35, "1", "1-sigma of the logarithm of the density of the day", _TRIAL)
COMPATIBILITY_NOISE_SPREAD = threshold(0.5, "1", "log sigma of noise among three instruments of one make", _TRIAL)
COMPATIBILITY_STEADY = threshold(3.0, "1", "constant transverse force counts against a correction", _TRIAL)
COMPATIBILITY_FURTHER_MISTAKE = threshold(1.5, "nats", "a further mistake in one record is less likely", _TRIAL)
COMPATIBILITY_BROKEN = threshold(0.012, "1", "relation 1 is broken: unexplained share beyond the noise", _TRIAL)
COMPATIBILITY_TIMES_NOISE = threshold(4.0, "1", "noise counts so many times before a share is unexplained", _TRIAL)
COMPATIBILITY_TUMBLING = threshold(45.0, "deg", "the nose turns too far for relations linear in the angle", _TRIAL)
COMPATIBILITY_STRAINED = threshold(0.003, "1", "relation 1 is strained: unexplained share beyond the noise", _TRIAL)
COMPATIBILITY_BROKEN_ALONE = threshold(0.7, "1", "gyros contradict themselves: unexplained share", _TRIAL)
COMPATIBILITY_AXIAL_WITHIN = threshold((0.5, 2.0), "1", "sound deceleration: true over sensed", _TRIAL)
COMPATIBILITY_AXIAL_SIGMAS = threshold(3.0, "sigmas", "the same: certainty of that ratio", _TRIAL)
COMPATIBILITY_PRESSURE_WITHIN = threshold((0.3, 3.0), "1", "sound density over the standard atmosphere's", _TRIAL)
COMPATIBILITY_NORMAL_WITHIN = threshold((-0.25, 0.04, 30.0), "1/rad", "slope: as found, of a body, most", _TRIAL)
COMPATIBILITY_DECISIVE = threshold(2.2, "nats", "a mistake of sign, axis or unit: gain by undoing it", _TRIAL)
COMPATIBILITY_DECISIVE_IF_STRAINED = threshold(4.5, "nats", "the same, of a strained record", _TRIAL)
COMPATIBILITY_CORRECTED = threshold(0.4, "1", "a correction restores a relation: unexplained part", _TRIAL)
COMPATIBILITY_NEARLY_EQUAL = threshold(1.0, "nats", "another correction is named beside the best", _TRIAL)
COMPATIBILITY_UNRELATED = threshold(0.5, "1", "gyros and accelerometers disagree: unexplained shares", _TRIAL)
COMPATIBILITY_QUIET = threshold(0.1, "1", "noise is small enough to say so: its share of a relation", _TRIAL)

# ---- Physics of a record, whatever the vehicle ----

_MISREAD = "tests.studies.independent.misread"
_SOUND = "tests.studies.soundness"
CLIMB_WITHIN = threshold(1.1, "1", "altitude or speed is wrong: climb over speed", _SOUND)
CLIMB_WIND = threshold(20.0, "m/s", "the same: beyond wind along the path and errors of the speed", _SOUND)
CLIMB_SIGMAS = threshold(5.0, "sigmas", "the same: certainty of the climb", _SOUND)
GAIN_WITHIN = threshold((0.5, 1.5), "1", "speed or height gained is wrong: over what the forces make", _SOUND)
THINNING_WITHIN = threshold((0.5, 2.0), "1", "altitude is wrong: power of the density by which drag goes", _MISREAD)
SOUND_WITHIN = threshold((220.0, 420.0), "m/s", "speed or Mach number is wrong: speed of sound", "air of 120 to 440 K")
DRAG_WITHIN = threshold((0.01, 20.0), "1", "forces or pressure are wrong: axial coefficient of any body", _SOUND)
MOUNTING_TILT = threshold(0.035, "rad", "the unit is turned in the vehicle: 2 deg between nose and x", _SOUND)
MOUNTING_SIGMAS = threshold(3.0, "sigmas", "the same: certainty of that angle", _SOUND)
GYROS_SURE = threshold(0.85, "1", "units and axes of gyros are known: unexplained share over the next", _SOUND)
HELD_FEWEST = threshold(20, "changes", "a channel has enough values to be called held or rounded", _STEPS)
HELD_REGULAR = threshold(0.8, "1", "a channel is held: share of its changes that come as regularly", _STEPS)
ROUNDED_REPEATS = threshold(0.2, "1", "a channel is rounded beyond its noise: share of samples that repeat", _STEPS)
ROUNDED_WITHIN = threshold(0.05, "steps", "the same: changes are whole numbers of the smallest", _STEPS)

# ---- Motion: filters, smoothing, the fit of forces and rates ----

WARNED_PER_CYCLE = threshold(20.0, "samples", "degraded: too few samples in a cycle of the motion", _LIMITS)
WARNED_ALPHA = threshold(0.1, "1", "warning: sigma of alpha over its rms; status degraded", _LIMITS)
WARNED_MOMENTS = threshold(0.2, "1", "warning: noise of the moments over their rms; status degraded", _LIMITS)
FORCE_UNEXPLAINED = threshold((0.1, 20.0), "1", "degraded: no motion has this force: part of its rms, noises", _GROSS)

# ---- Format of a record ----

MINIMUM_SAMPLES = threshold(16, "samples", "a record, or its longest segment, is too short to use", _FORMAT)
SLOWEST = threshold(0.1, "m/s", "a slower vehicle is at rest: its sample is refused", _FORMAT)
SHORTEST_STEP = threshold(1e-7, "s", "time is in a larger unit than stated and the record is refused", _FORMAT)
LARGEST_PROPERTY = threshold(1e9, "SI", "a property of the vehicle is a fill value (or its inverse)", _FORMAT)
TUMBLING_ALPHA = threshold(60.0, "deg", "beyond this a moment is nowhere near linear in the angle", _USABLE)
TUMBLING_SHARE = threshold(0.05, "1", "of squared dynamic pressure beyond it: the flight is refused", _USABLE)

# ---- Priors of what a hypothesis may have beside it: centre and 1-sigma of the logarithm of an amplitude ----

_FLIGHTS = "judgement; held by tests.studies.independent.imperfect_study"
RECORD_AMPLITUDE = threshold((-2.3, 2.0), "log units", "size of drifts of instruments and air, in usual ones", _FLIGHTS)
MOMENT_AMPLITUDE = threshold((-4.6, 1.5), "log units", "size of moment processes, of the static moment's", _FLIGHTS)
MECHANISM_AMPLITUDE = threshold((-2.3, 1.2), "log units", "of a mechanism's terms, of the static moment's", _FLIGHTS)
BOUND_COSTS = threshold(0.5, "1", "a mechanism is impossible: part of its gain that bounds cost", _FLIGHTS)
WINNING_PROBABILITY = threshold(0.9, "1", "named, or none adequate: its posterior", "convention that users quote")
CREDIBLE_PROBABILITY = threshold(0.02, "1", "a rival may be right beside the leader: its posterior", _FLIGHTS)
OTHER_PRIOR = threshold(0.2, "1", "prior that something outside the list acted", "contract of `compare --json`")
OUTSIDE = threshold(0.1, "1", "a shape is on no list: its rms beyond what each mechanism reproduces", _FLIGHTS)
SPECIFIC = threshold(5.0, "nats", "terms of a mechanism are significant", "Kass and Raftery 1995: very strong")
FAMILY_SIGNIFICANT = threshold(3.0, "nats", "a family explains some of a residual", "Kass and Raftery 1995: strong")
FAMILY_MAJORITY = threshold(0.5, "1", "a family explains most: its share of the residual", "majority, by definition")
FAMILY_REST = threshold(0.1, "1", "an effect replaces processes: what its family adds, of what it explains", _FLIGHTS)
ALWAYS = threshold(0.1, "1", "prior that a mechanism acts throughout the record", _FLIGHTS)
EVENTS_APART = threshold(0.01, "1", "an event's time on a flight from that of all, 1-sigma, of the record", _JOINT)
NOISE_LEVEL = threshold((0.0, 0.1), "log units", "how well a record states its own noise", _FLIGHTS)
ONSET_TAKES_TIME = threshold(3.0, "nats", "a change is no jump but takes time", "Kass and Raftery 1995: strong")
MECHANISM_ACTS = threshold(10.0, "nats", "price of a mechanism that acts: twice very strong", _FLIGHTS)
FURTHER_REGION = threshold(10.0, "nats", "a mechanism acts in a further region: twice very strong", _FLIGHTS)
MOST_REGIONS = threshold((2, 0.1), "1", "a name: regions with more than that of its squares", _FLIGHTS)
FAR_TOLERANCES = threshold(5.0, "1", "tolerances of an error beside which a cause is not established", _FLIGHTS)
FAR_PROCESS = threshold(20.0, "1", "ordinary sizes of a process: far beyond them", "1.5 to 2 sigma of its prior")
NORMAL_95 = threshold(1.96, "1", "standard deviations on either side that hold 95 %", "normal distribution")
NOISE_EXCESS = threshold(1.2, "1", "a residual is no noise: its mean square over the noise's", _FLIGHTS)
REFUSED = threshold(0.05, "1", "chance of a difference, below which a flight contradicts a frozen model", "Fisher 1925")
