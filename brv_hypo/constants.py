"""Every constant that decides a verdict, a finding or a fault of the record, in the order in which data flow.

Beside each stands what it is of and why it is as it is; over each section the studies that its constants were set by,
or whose figures (brv_hypo/docs/validation.md) hold with them. A constant that names no source or study of its own was
set by judgement.

Not here: what guards arithmetic (rounding, ridges, cutoffs near machine precision), bounds memory or the size of
inputs, is physics, units or part of a format (the grades of instruments), the parameters that a mechanism or effect
offers (its plugin), what `import --guess` proposes to a user, what is drawn or listed, what a study plants, and the
numerics of `brv_hypo.subset` and `brv_hypo.likelihood`, which know nothing of flights.
"""

from __future__ import annotations

import math

# ---- Foreign records: clocks, pad, phases, ascent, rate ----
# Judgement; held by tests/flight/test_rocket_log.py, which makes logs of known flights, and test_launch12.py, which
# reads the measured log of L-12.

CLOCK_STEPS_PER_SAMPLE = 2.0  # of the slower recorder: the grid of offsets that are tried
CLOCK_LEAST_OVERLAP = 0.3  # of the shorter record
CLOCK_LEAST_CORRELATION = 0.8  # of what both recorders sensed, below which no offset is believed
PAD_FEWEST_SAMPLES = 20  # from which biases are taken
PAD_LEANING = math.radians(5.0)  # rad, 1-sigma of the rail's lean: launch rails stand within some 5 deg of the vertical
PAD_MOVING = math.radians(2.0)  # rad/s of standard deviation: beyond any wind on a rail
PHASE_SMOOTHED = 0.1  # s: a median over this takes vibration and spikes out
PHASE_SHORTEST = 0.3  # s of a phase
PHASE_AT_REST = 0.15  # gravities by which a reading along the axis may be off gravity at rest
PHASE_RESTING = 0.9  # share of the samples before ignition that have to read so for a pad
PHASE_THRUST = 1.5  # gravities sensed, beyond what any instrument's bias makes of gravity
PHASE_BURNT_OUT = 0.0  # m/s^2 along the axis: drag alone is left
# A parachute pulls with so many times what was sensed in the seconds before it, and with so many gravities.
PARACHUTE_TIMES = 5.0
PARACHUTE_BEFORE = 2.0  # s
PARACHUTE_LEAST = 2.0  # gravities
ASCENT_RATE = 20.0  # Hz at which the filter runs: the speed has no faster content that a barometer could tell
ASCENT_WANDERING = 0.3  # m/s^2 per root second: the lean of a path bends as it turns over
ASCENT_HEIGHT_AT_FIRST = 100.0  # m, 1-sigma
ASCENT_SPEED_AT_FIRST = 1e3  # m/s, 1-sigma: unknown
ASCENT_OFF_AT_FIRST = 0.3  # m/s^2, 1-sigma, of what the acceleration is off
ASCENT_LEAN = math.radians(10.0)  # rad, 1-sigma of the path's lean: the speed is that much larger than its climb
ASCENT_LEAST_SIGMA = 1.0  # m: no barometer is better
ASCENT_REPEATS = 6  # rounds of weights
ASCENT_DEGREES_OF_FREEDOM = 4.0  # of Student's t, by which altitudes off the climb count less
ASCENT_FEWEST = 20  # samples with force and altitude
ASCENT_KNOWN_SPEED = 3.0  # sigmas: a derived speed below so many is unknown
STEADY_PROPERTY = 0.002  # relative change of a mass property over the window, below which it counts as constant
DENSITY_OF_THE_DAY = 0.03  # 1-sigma, relative, about a standard atmosphere below 20 km
# Samples that a cycle of the transverse oscillation keeps: a moment is differentiated from its rates, and delays are
# shorter than a cycle.
DECIMATED_PER_CYCLE = 30.0
DECIMATED_LEAST_GAIN = 2.0  # times the samples that the motion needs, below which a record is left as it is
DECIMATED_PASS_END = 0.3  # of the new rate
DECIMATED_STOP_BEGIN = 0.5  # of the new rate: nothing is aliased
DECIMATED_STOP_DECIBEL = 60.0  # by which the filter stops
DECIMATED_KNOWN = 0.6  # share of the filter's weight that must lie on samples that are there
VIBRATION = 20.0  # Hz: no rigid vehicle oscillates faster

# ---- Trial of the record, channel by channel: clock, stuck, spikes, bursts, gaps ----
# Judgement; clock steps and bursts were revised with `brv_hypo.study.record_faults`, clock steps, spikes and gaps with
# `tests.independent.faulty_records` (every fault in turn, sound records and blemishes), whose figures hold with all.

CLOCK_FLANK = 6  # samples on either side of an odd interval
CLOCK_MOST_STEPS = 5  # more odd intervals are jitter or dropouts, and no steps
# The samples run on where a cubic through the closed interval misses them by this, in squares over noise, or less.
CLOCK_RUNS_ON = 2.0
# Or by this share of what one through the interval as it is stamped does: motion may be too fast for a cubic (seed
# 161505 of the faulty records).
CLOCK_FAR_BETTER = 0.01
CLOCK_WORST_CHANNEL = 2.0  # times the mean misfit that is allowed, that any channel may have
# Unless so many channels would have moved by so many sigmas in the time of the interval, nothing can be said.
CLOCK_FEWEST_MOVED = 2
CLOCK_MOVED_SIGMAS = 8.0
CLOCK_SLOPE_SIGMAS = 5.0  # standard errors by which such a trend must be known
# A channel jumps where the parabolas before and after, of so many samples, miss each other by so many robust standard
# deviations, and by so many times the misses up to so many flanks away: parabolas miss fast motion all the time.
JUMP_FLANK = 8
JUMP_SIGMAS = 12.0
JUMP_TIMES_AROUND = 3.0
JUMP_AROUND = 5
STUCK_FEWEST_SAMPLES = 50  # of a channel that can be told to be stuck
STUCK_BLOCKS = 20  # of a channel, in which it is counted how often values repeat
STUCK_QUIET = 0.25  # quantile of the blocks in which a channel repeats itself least
STUCK_LIVELY = 0.9  # quantile of those in which it does most
STUCK_REPEATS_SELDOM = 0.02  # share of repeated samples, in the quiet blocks of a channel that does not repeat itself
# No channel is believed to repeat itself less often: it bounds how short a run may be that counts (4 samples).
STUCK_LEAST_SHARE = 1e-3
STUCK_CHANCE = 1e-6  # of a run as long in a whole channel, below which it counts
# A stuck channel that repeats itself by nature ends in a jump of so many of its largest common steps, the quantile.
STUCK_RELEASE = 5.0
STUCK_COMMON_STEP = 0.99
FLAT_RUN = 3  # samples at the extreme value, one after the other
FLAT_SAMPLES = 5  # at that value in all
FLAT_TIMES = 5.0  # a flat top of a quantised channel holds so many times the samples of any level next to it
FLAT_LEVELS = 3  # levels that are next to it
MOST_CLIPPED = 0.05  # share of a channel beyond which it is not masked, but decides: what is left is too patchy
MOST_STUCK = 0.5  # share of a channel beyond which too little is left
DEAD_NOISE = 1e-9  # white noise over the channel's greatest value, which only a real or simulated instrument has
DEAD_CHANGE = 0.02  # relative change of the speed that a constant gauge must have missed to be called dead
DEAD_PUSH = 2.0  # times that change that the axial force must make of a speed
SPIKE_SIGMAS = 8.0  # robust standard deviations by which a run stands out from the cubic about it
# Times the largest second difference around it: a sinusoid reaches 2/3 of that, a step or a kink 1 (arithmetic in
# brv_hypo/flight/spikes.py).
SPIKE_TIMES_CURVATURE = 2.0
SPIKE_TIMES_FOURTH = 2.5  # or the largest fourth: a sinusoid near the sampling rate reaches 2.02 (seed 161603)
SPIKE_NEIGHBOURS = 4  # samples on either side
SPIKE_LONGEST = 2  # samples
SPIKE_LARGEST_FRACTION = 0.02  # of a channel: more of them are its noise
SPIKE_PASSES = 4  # as spikes hide each other
BURST_SHORTEST = 3  # samples
BURST_LONGEST = 60  # samples
BURST_FLANK = 8  # samples on either side, through which a polynomial goes
BURST_ORDER = 5  # its degree
BURST_SIGMAS = 8.0  # robust standard deviations of an edge, and of the departure
BURST_TIMES_AROUND = 3.0  # times the third differences around, which no motion and no kink shows
BURST_EDGE_OCTAVES = 1.0  # by which a step to the departure may differ from it: a factor of two
BURST_LARGEST_FRACTION = 0.05  # of a channel
BURST_MOST_EDGES = 200  # of a channel; more are its nature
# Differences of this order pass white noise and cut a motion of 14 samples per cycle by five decades: the one estimate
# of a channel's white noise.
NOISE_DIFFERENCES = 8
NOISE_STILL = 0.5  # share of a channel's steps that are none, from which its rounding is its noise
UNIFORM_WITHIN = 0.01  # of a step: stamps that lie so near an even grid are kept
MISSING_BEYOND_STEPS = 1.5  # steps between two stamps, from which samples are missing
GAP_BEYOND_MEDIANS = 2.5  # median intervals, from which an interval counts for no mean step
LARGEST_GROWTH = 50  # times the samples that an even grid may have, beyond which the stamps are refused
BRIDGED_SAMPLES = 5  # missing ones that are bridged in rates and forces
BRIDGED_CYCLES = 1.0 / 8.0  # of the transverse oscillation: a cubic is within 1 % of the amplitude
BRIDGED_SECONDS = 1.0  # s, in the slowly varying air data
# Cycles of the transverse motion that a quintic crosses, its flanks as long as the gap, to 1e-3 of the amplitude.
CROSSED_CYCLES = 1.0 / 8.0
CROSSED_FLANK = 8  # samples on either side at least
CROSSED_ORDER = 5  # of the polynomial
PRESSURE_CONSISTENT = 0.05  # relative difference from density times speed squared over two, beyond which a note says so
# A record that is far more finely sampled than its motion needs is analysed as means: samples left to a cycle of the
# fastest motion, samples up to which it is analysed as it is, samples left of a longer one at least. Means damp by
# 2e-4 of the motion (brv_hypo/flight/averaging.py), and bound the time.
AVERAGED_PER_CYCLE = 96
AVERAGED_BEYOND = 20_000  # samples
AVERAGED_LEFT = 4_000  # samples
TOLERANCE_LEAST = 1e-3  # share of the laboratory's that a tolerance stated as zero counts as: nothing is known exactly
# What `inspect` says of the noise: trusted where the upper half of the spectrum is level within the first factor, and
# at the estimate within the second; warnings below so many samples a cycle.
INSPECTED_LEVEL = 1.5
INSPECTED_AGREES = 1.25
INSPECTED_FEWEST_SAMPLES = 50  # of a periodogram
INSPECTED_PER_CYCLE = 10.0  # samples

# ---- Trial of the record: gyros against accelerometers against air data ----
# Held by `brv_hypo.study.record_faults` and `tests.independent.faulty_records` (faults named, sound records refused),
# and by `tests.independent.study` (sound records refused).

TRIAL_FEWEST_SAMPLES = 64  # of a segment that is judged
TRIAL_MOST_SAMPLES = 300  # that it is thinned to; bounds the time
TRIAL_ALTITUDE_DEGREE = 3  # of the polynomial through the altitude: it is noisy, and its rate changes slowly
# Below these shares of what is to be explained a relation counts as kept: mechanisms act on moments, and leave more
# of the second and third.
TRIAL_KEPT = (0.002, 0.1, 0.1)
TRIAL_TOO_NOISY = 0.3  # share of what is to be explained that is noise, from which a relation tells nothing
# Of any body: slope of the normal force per rad, on the base area, and its spread as a factor e^x: slopes from 0.3 to
# 4.4 within one sigma.
TRIAL_NORMAL_SLOPE = 1.2
TRIAL_NORMAL_SPREAD = 1.3
# 1-sigma of the wind along the path, m/s: at least this, or so many tolerances of the flight; it keeps to itself over
# this share of a segment. Airspeed shows its changes as if they were decelerations.
TRIAL_WIND = 10.0
TRIAL_WIND_TOLERANCES = 2.0
TRIAL_WIND_MEMORY = 0.5
TRIAL_GRAVITY = 10.0  # m/s^2, of a planet that is not known
TRIAL_GRAVITY_DOUBT = 0.2  # 1-sigma share of gravity along the path that the altitude leaves open
TRIAL_GRAVITY_UNKNOWN = 1.0  # and what is open without altitude: as much as itself
TRIAL_LIFT_DOUBT = 1.0  # 1-sigma of the deceleration by lift, in what it is where the force has the slope of any body
TRIAL_ANY_SPEED = 1e3  # m/s, 1-sigma of the speed that a segment starts with: open
TRIAL_AXIAL_SAMPLES = 60  # that tell the deceleration; the time goes with their cube
TRIAL_AXIAL_SPREAD = 0.25  # of the logarithm of true over sensed deceleration
TRIAL_AXIAL_REACH = 4.0 * TRIAL_AXIAL_SPREAD  # logarithms of it that are tried
TRIAL_AXIAL_STEPS = 41  # values tried, a fifth of a spread apart
TRIAL_DENSITY_SPREAD = 0.35  # of the logarithm of the density of the day: a factor 1.4 either way
TRIAL_NOISE_SPREAD = 0.5  # of the logarithm of noise among the three of a triad
TRIAL_STEADY = 3.0  # times what swings (and 1 m/s^2) that a constant transverse force may be before it counts
TRIAL_FURTHER_MISTAKE = 1.5  # each further mistake in one record is less likely by a factor e^x
TRIAL_MOST_PER_CHECK = 6.0  # -ln likelihood that no single check counts beyond
TRIAL_MOST_OF_NOISE = 3.0  # the same for each triad's noise
# A relation is broken where this share is left beyond so many times what noise leaves. Sound records leave 0.04 at
# most: 90 simulated flights with all instrument grades, and the measured entry of Opportunity.
TRIAL_BROKEN = 0.012
TRIAL_TIMES_NOISE = 4.0
TRIAL_STRAINED = 0.003  # share from which it is strained: then a mistake must explain more before it is named
TRIAL_BROKEN_ALONE = 0.7  # share that gyros alone must leave where accelerometers cannot tell; mechanisms leave to 0.5
TRIAL_AXIAL_WITHIN = (0.5, 2.0)  # true over sensed deceleration, beyond which no tolerance explains it
TRIAL_AXIAL_SIGMAS = 3.0  # standard errors of that ratio
TRIAL_PRESSURE_WITHIN = (0.3, 3.0)  # density over that of the standard atmosphere, the same
TRIAL_NORMAL_WITHIN = (0.04, 30.0)  # slope of the normal force per rad, the same
# A mistake is named where undoing it raises ln likelihood by this much (where the record is strained but not broken, by
# that), and leaves this share of what was broken.
TRIAL_DECISIVE = 2.2
TRIAL_DECISIVE_IF_STRAINED = 4.5
TRIAL_MENDED = 0.4
TRIAL_NEARLY_EQUAL = 1.0  # ln likelihood: corrections this near to the best are told beside it
# Nothing mends it, and this share of each instrument, or more, does not follow from the others: sound records leave
# 0.04 of the first relation, a measured sounding rocket in gusts, of unknown axes, 0.95, 0.75 and 0.89. Noise may be
# this share of it at most.
TRIAL_UNRELATED = 0.5
TRIAL_QUIET = 0.1
# A flight whose rates (rad/s) are faster, or whose moments of this coefficient would change the rates by less than this
# share of what they swing, cannot be answered: ten thousand turns a minute and that coefficient are beyond any vehicle.
FASTEST_RATE = 1e3
LARGEST_MOMENT = 1.0
LEAST_SWING = 1e-3

# ---- Motion: filters, smoothing, the fit of forces and rates ----
# Held by `tests.motion.study` and `tests.independent.study`: errors of angles and moments against those stated.

DERIVATIVE_ORDERS = (2, 4, 6)  # degrees of the local polynomials that are tried
DERIVATIVE_BIAS_COUNTS = 16.0  # times squared bias counts against variance: later statistics know the variance alone
DERIVATIVE_PAST_VALLEY = 3.0  # times the least error so far: wider windows of this degree only lose
DERIVATIVE_DOUBT = 4.0  # standard errors by which the bias against a noisy reference must show
DERIVATIVE_CORRELATED = 4.0  # samples over which its noise is correlated
DERIVATIVE_WIDENING = 1.25  # from one window that is tried to the next
DERIVATIVE_WINDOWS = 5  # of the widest window, that the longest stretch holds at least
SMOOTH_INTERVALS = 64  # of a smoothing spline, at most: roll rate and density vary slowly
SMOOTH_PER_INTERVAL = 6  # samples at least, so that noise can be told from the signal
SMOOTH_PENALTIES = (-14.0, 15.0, 117)  # powers of ten, four a decade, from none to a parabola
SMOOTH_ORDER = 3  # of the differences that are penalised: a parabola is smooth
DENSITY_PASSES = 3  # Gauss-Newton steps, from the density smoothed as it stands
DENSITY_LEAST = 1e-3  # of the largest: where the pressure is lost in its noise its logarithm means nothing
INPUT_FEWEST_SHAPES = 10  # of the error that is left in a smoothed input
INPUT_MOST_SHAPES = 40  # and at most
INPUT_TOLD = 0.5  # sigmas of the rates' noise down to which a shape is told
INPUT_FOLLOWED = 1.2  # what a spline that follows its input may leave, in white noise of the channel
FREE_GRAVITY = 30.0  # m/s^2 that gravity may be where the planet is not known
LEAST_CYCLES = 0.5  # of the nose, that a record counts as
AXIAL_SEEN = 25.0  # squares of standard errors by which the axial coefficient has to change (seed 162023)
POLAR_DOUBTFUL = 0.1  # relative, or rad: instants whose meridian or precession is known no better are passed over
# What bends may be as large at this angle of attack (rad, about ten degrees) as what is in proportion (1 sigma).
BENT = 0.2
TIE_ENDS = 4  # samples at the ends of a segment that tie nothing: what a late clock makes of them is outside the record
TIE_MOST_STRETCH = 4.0  # of an observation that hardly changes along the crossflow: it says little there
TIE_ROUGH_SLOPE = 3  # coefficients of the force's slope before it is chosen: a parabola
TIE_SLOPE_COUNTS = (1, 2, 3, 4, 6, 9, 13)  # coefficients of its course in time that are tried, by BIC
TIE_PATIENCE = 2  # of these that may go by without a gain
TIE_MOMENT_SLOPE = 4  # coefficients of the moment's slope while its noise is found
TIE_MOMENT_ANOMALY = 0.1  # of the moment's rms, that is taken for noise at first
TIE_MOMENT_ROUNDS = 2  # of its noise
# Its noise is that of a twelfth of the record (at least so many samples) on either side, correlated to where the
# correlation has fallen to this.
TIE_MOMENT_WINDOWS = 12
TIE_MOMENT_WINDOW_LEAST = 8
TIE_MOMENT_UNCORRELATED = 0.1
TIE_FORCE_OUTLIER = 6.0  # standard deviations from which a force is a spike, far beyond Gaussian noise
TIE_FORCE_ENOUGH = 0.1  # of alpha's rms: the force alone is enough where alpha is then known to this
TIE_FORCE_FAR_LESS = 0.8  # of what was taken for noise: a slope that leaves less is chosen again
MOTION_ROUGH = 0.01  # of the crossflow's rms, to which the motion is found about which errors are linearised
# They are linearised anew about what was found of them, at most so often, and again where that had moved the
# crossflow by more than this share of its standard deviation.
MOTION_LINEARISATIONS = 6
MOTION_MOVED = 0.1
MOTION_MOST_STEPS = 25  # Gauss-Newton steps; bounds the time where they do not settle
MOTION_CONVERGED = 1e-2  # of the crossflow's standard deviation given the globals, by which the last step changes it
MOTION_LEAST_RELAXED = 0.1  # of the share before, that is taken of a step
MOTION_FAR_START = 0.5  # of the speed: a start off the nose's mean by more is not tried
MOTION_START = 0.3  # of the speed, 1-sigma of the walk at the first sample
# Width of differences by errors of the record, in standard deviations: what is of second order in it would tell apart
# errors that the record cannot (both clocks of the inertial unit late by 1 sigma is a motion 1 sigma later).
RESPONSE_STEP = 1e-2
RESPONSE_TURN = 1e-5  # rad, half the width of differences by the start's direction
RESPONSE_PULL = 5e-3  # m/s^2, the same by gravity
MOMENT_SLOPE_STEP = 1e-6  # of a quantity, or of its unit where that is more, half the width of a moment's slope by it
RESPONSE_PER_CYCLE = 24  # samples of the fastest motion that carry what errors do: 2e-6 of it is lost between them
RESPONSE_FASTEST = 95.0  # percentile of the meridian's rate that is the fastest motion
WARNED_LEFT = 10.0  # percent of the moments that fitted errors of the record leave, below which a warning tells it
# Warnings, by which `maximum_likelihood: quick` leaves a record out: samples a cycle, sigma of alpha over its rms,
# noise of the moments over their rms, gravity found over that expected.
WARNED_PER_CYCLE = 20.0
WARNED_ALPHA = 0.1
WARNED_MOMENTS = 0.2
WARNED_GRAVITY = 2.0

# ---- Motion: nodes between samples ----
# Set after seed 75265 of `tests.independent.study`, with `tests.independent.integrals`.

# Way of the crossflow from node to node, of its least distance from zero on that way: the meridian turns by no more,
# rad. Splines through a damping or a constant moment that turns so err by some 1e-5 of it.
NODE_TURN = 0.4
# What the crossflow moves by in a usual delay, of its size; how much the turn of the meridian in it may change by from
# node to node, rad: what is late turns by it.
NODE_LATE = 0.5
NODE_WOUND = 0.5
NODE_HALVINGS = 7  # of a sample: what turns faster does so in less than a hundredth of a sample
NODE_MOST = 8  # added to a stretch at most, of its samples: noise passes by zero all the time

# ---- Priors of the model, and the time that flights share ----
# Judgement about bodies, that of the schedule after results on the measured entry had been seen; held by
# `tests.independent.study --drawn`, whose bodies bend, by `tests.independent.loop_study`, and, of common time, by
# `tests.independent.joint` and `tests.independent.two_flights`.

# Standard deviation of the slope's change along Mach numbers, over its mean, and the ratio of Mach numbers, as a
# logarithm, over which it changes: blunt and slender shapes change by such shares within a doubling.
SCHEDULE_RELATIVE = 1.0
SCHEDULE_LENGTH = 0.7
SCHEDULE_SMALLEST = 3e-3  # of the first term's prior, below which a term says nothing
SCHEDULE_NOTHING = 1e-3  # of the process's own size, the same
SCHEDULE_MOST = 24  # terms
BEND_DRIFT = 0.5  # what the bend changes by, of itself (1 sigma), between the ends of a flight: about what slopes do
COMMON_SPLINES = (4, 6, 8, 12, 16)  # by which a Mach number falls or rises over a record: as many as it needs, by BIC
COMMON_MEANS = 400  # of neighbouring samples, that are fitted
COMMON_ASKED = 40  # of neighbouring samples, that are asked whether they follow
COMMON_DEGREE = 5  # the highest in its own time of what a flight's common time is tried as
COMMON_ROUNDS = 4  # of its least squares
# Share of its range by which those means may stray (rms) from what only falls or only rises, if Mach number is to tell
# time: a fifth of what lies between two of the usual seven knots.
COMMON_STRAYING = 0.025
COMMON_SLOWEST = 0.02  # pace of a Mach number over its mean: where it stands still, it does not tell time at all
# Half waves that a slow wind makes over the record, the k-th 1/k as large as the first: so many, or one for so many
# metres of height, as waves in the atmosphere have vertical wavelengths of some kilometres, but no more than are worth
# their columns. Judgement; Opportunity's entry passes 43 km: its held-out error before any step is 3.7e-8 with 5, 2.2,
# 1.9, 1.6 and 1.7e-8 with 16, 20, 24 and 32.
WIND_HALF_WAVES = 5  # at least
WIND_HALF_WAVE_HEIGHT = 2000.0  # m
WIND_MOST_HALF_WAVES = 24  # at most
# Instants at which a step of the wind is tried first: the attitude's own errors follow all of it but what happens
# within a part of a second, so that one a grid's step away looks like nothing (with 16, `tests.independent.loop_study`
# had 3 of 4 misnamed).
WIND_STEP_INSTANTS = 48
WIND_STEP_CLOSER = 7  # instants tried next, over 3/4 of the spacing to either side

# ---- Regression: noise of the rows ----
# Held by `tests.independent.study --coloured` (half of its flights in noise that lasts) and
# `tests/independent/test_coloured_noise.py`.

FORCE_SPIKE = 7.2  # residuals of the normal force, in their median, from which a sample is a spike
FORCE_SPIKE_ROUNDS = 2  # of the force's fit without spikes
WALK_FEWEST_MODES = 10  # sines of the attitude's random walk
WALK_MOST_MODES = 80  # bounds the time
# Sines for each cycle of the motion. A walk at frequency f turns the vehicle by the static moment, which is (f_n / f)^2
# of the noise that the walk is made of: half as fast again as the motion, with two sines a cycle, it is lost in it.
WALK_MODES_PER_CYCLE = 3.0
WALK_LEFT_OUT = 0.8  # standard deviations of alpha, of what the sines may leave of the walk
NOISE_MOST_TIED = 0.995  # of a direction's noise, that goes to unknowns: what is left keeps the rows regular
NOISE_ORDER = 12  # largest of its autoregression
NOISE_SAMPLES_PER_ORDER = 20  # of the residuals
NOISE_MOST_UNTHINNED = 8000  # rows up to which the fit that leaves the noise keeps all; beyond it takes next to none
NOISE_PER_CYCLE = 12  # rows that a cycle of the fastest motion keeps where whitened rows are averaged
NOISE_BEYOND = 2.0  # times the fastest motion's frequency, above which a spectrum is noise alone
NOISE_STRETCHES = 16  # of time, that the spectrum is the median of
NOISE_SHORTEST_STRETCH = 32  # samples
NOISE_LONGEST_STRETCH = 256  # samples: the spectrum's lines are a 256th of the sample rate apart
NOISE_LEAKS = 2.0  # lines over which one of them leaks under a Hann window: half its main lobe
NOISE_COLOURS = (0.0, 0.98, 99)  # correlations of neighbouring samples that are tried
NOISE_ALLOWED_FALL = 1.0  # of 2 ln L, that a correlation seen elsewhere may bring: one sigma
NOISE_CORRELATED = 2.0  # sigmas of a correlation below which samples count as independent from there on
NOISE_MOST_LAG = 50  # samples to which that is looked for
# Splines in time of each shape of the free moment that the noise is left by, and rows that each column needs: they take
# at most a twelfth of the noise with them.
FREE_MOST_SPLINES = 10
FREE_FEWEST_SPLINES = 4
FREE_ROWS_PER_COLUMN = 12
ERRORS_REACH = 1e-3  # probability of errors under their tolerances, down to which they are taken out as they are

# ---- Regression: search and refinement of knots, delays and terms ----
# Bound the time; held by `tests.independent.study` (how often the truth wins where the oracle parts it from rivals).

COMPARED_KNOTS = 11  # where coefficients may change, if a user sets none
COMPARED_TERMS = 6  # columns that a hypothesis may add, if a user says nothing else
COMPARED_EXACT_TERMS = 4  # up to which the search is exact, the same
SEARCH_PATIENCE = 2  # sizes that may go by without a gain before the search over sizes ends
SEARCH_BEST = 2  # subsets of each size that a search keeps
SEARCH_STARTS = 2  # of those on the grid that are refined
SEARCH_NARROWINGS = 3  # searches on a model's own knots and thetas, while they gain
SEARCH_FINE_SCANS = 3  # of the parameters of the model settled on, while they gain
# A hypothesis whose criterion stays this far (twice ln L) behind another after so many terms is not searched further.
SEARCH_OUT_OF_REACH = 400.0
SEARCH_SIZES_TRIED = 3
# Behind another from which its best on the grid, refined, stands for it. Judgement: of 21 flights none had another name
# or other equivalents for it.
SEARCH_HOPELESS = 1000.0
SEARCH_EXCHANGES = 2  # of knots for the best others, of which each gains
SEARCH_FINER_KNOTS = 4  # intervals of one between two knots where a single choice is made anew
SEARCH_SAME_KNOT = 0.25  # of the spacing, within which two knots are one where a model's own are searched
SEARCH_SAME_THETA = 0.1  # relative difference up to which two values are one, found twice (refined at two knots)
SCANNED = 7  # values of a parameter that are tried before Gauss-Newton
SCANNED_FINELY = 25  # and once more about the model that was settled on
SCANNED_FACTOR = 1.6  # of a theta either way
# Half the width of differences by knots and delays, of their bounds; steps at most, and the gain in 2 ln L below which
# they end. Of models that are compared: a tenth of what one term costs.
REFINED_WIDTH = 2e-3
REFINED_STEPS = 6
REFINED_GAIN = 0.2
# Fall of 2 ln L by which one model has to beat another to take its place. The same model found again, by way of
# another, differs by what steps left, or by rounding alone, which must decide nothing: of three flights in another
# order (seed 4941 of `tests.invariance`) another model was chosen, 17 of 2 ln L apart.
SEARCH_GAIN = REFINED_GAIN
SEARCH_TIED = 1e-3  # of 2 ln L, within which the first that was found is taken
REFINED_HALVINGS = 4  # lengths of a step that are tried
# Of one that is told, or linearised about. Where a model leaves much, ten steps each gain more than 0.05, and how they
# began shows in where the first six end. Wide slopes lead over samples, where slopes jump; between two samples narrow
# ones lead on, to where there is none: a wide one that reaches over the next sample stops short of it.
SETTLED_STEPS = 40
SETTLED_GAIN = 1e-6
SETTLED_LAST_STEPS = 10
SETTLED_LAST_WIDTH = 1e-5
# Steps that are taken as they are, and what one may lose of 2 ln L: by a limit that rounding passes (6e-4) a knot of
# the cone stopped 3e-10 s short, 1.3e-6 standard errors.
SETTLED_WHOLE_STEPS = 2
SETTLED_LOSS = 1e-2
# The static moment that a model told lags behind or sticks to: rounds at most in which it is brought up to date, and
# how far the prediction may still move in the last, in standard deviations. A round leaves a tenth to a half of what
# the one before left; one alone left 0.009 standard errors of a fraction (seed 983 of `tests.invariance`; 0.06 on seed
# 670), and differences of 6e-6 between the same flight in other units. Where the last round led is mixed with where the
# one before it did, by shares that go with rounds that leave -1 to 0.9 of what there was. Where a round twice leaves
# more than so much of the least so far, what moves is a delay that the data hardly tell.
FOLLOWED_ROUNDS = 20
FOLLOWED_APART = 1e-7
FOLLOWED_FALL = 0.7
FOLLOWED_MIXED = (-9.0, 0.5)
FOLLOWED_STALLS = 2
# A moment that turns in the body: rates tried at most, half to either side (beyond half a turn a record apart they are
# independent), and times the motion's own (roll, and the meridian's in nine tenths of the time) up to which it turns.
TURNING_RATES = 160
TURNING_FASTEST = 3.0
TURNING_MERIDIAN = 90.0  # percentile of the meridian's rate

# ---- Verdict: linearisation, baseline ----
# These and the next three sections were worked out on the seeds of `tests.independent.study` that validation.md lists,
# and are judged together by its fresh ones.

COMPARED_SMALLEST = 60  # samples; rule of thumb: four for each of baseline and six terms
# How often a record is linearised about the errors that it shows, and the tolerances, in length over all errors, by
# which the next estimate may differ before it is done again. One of them 4 off left 450 in 2 ln L, 3 left 13, below 1
# nothing (industrial instruments); the length is 1.8 times the largest of them in the median of 60 (seeds 192000 to
# 192026).
MOST_LINEARISATIONS = 4
SETTLED_ERRORS = 2.0
# Times the noise's mean square that a baseline may leave, whose fit is believed to tell errors of the record. Of six
# strong effects that were "none adequate" (165540, 165832, 166030, 166078, 166361, 320212: 2.5 to 5,800 times) five are
# named; flights on which it leaves 1.6 times or less are told better about its fit.
BASELINE_BELIEVED = 2.0
# Estimate over tolerance from which an error of record or vehicle is named (2 of 48 flights whose errors were drawn at
# their tolerances, seed 404000), and how many of them are.
BEYOND_TOLERANCE = 3.0
BEYOND_TOLERANCE_NAMED = 3
# Sigma that the instruments' noise shows at the motion's frequency, over that of neighbouring samples, from which the
# motion is reconstructed with it: correlations of neighbouring samples above 0.2.
COLOURED = 1.5
LINEARISED_AGAIN = 2400.0  # fall of 2 ln L that the leader brings, from which the problem is linearised about it
SETTLED_FALL = 12.0  # fall of 2 ln L of what the leader leaves, below which another linearisation has changed nothing
HEARD_SHARE = 1.05  # of the noise beside the leader, from which what that leaves is more
LINEARISATIONS = 4  # about what explains much of the flight, while that lowers what is left
# Linearisations that may lower nothing, and further searches, where something else stands beside the leader: a flight
# with industrial instruments is found in steps of which some lower nothing. Of four strong effects that were "none
# adequate" three are named (345005, 345015, 345028, the last in the second search; not 345032, in three).
LINEARISED_IN_VAIN = 2
SEARCHED_AGAIN = 2
OFFSET_DEGREE = 1  # Legendre degree in time of the drift of C_N0
SLOPE_DEGREE = 3  # and of that of C_Nalpha: a speed that falls by a tenth bends it beyond a parabola
# Share of the speed by which it may depart from such a polynomial before C_Nalpha follows it too: stiffness follows
# Mach number about in proportion, and a change of it of a few parts in ten thousand of the moment is not seen.
WAVERING_SPEED = 5e-5

# ---- Verdict: adequacy, what is outside the list ----

DETECTABLE = 25.0  # fall of 2 ln L that the weakest "something else" is expected to bring: the detection limit's F
OTHER_SIZES = 7  # of "something else" tried, each twice the one before: to 64 times the weakest
OTHER_UNSEEN = 1e-6  # of the best seen direction of a free moment: what the data see less does not count
# Gain in 2 ln L that "something else" has at most on sound flights, above which it is believed: 8 lets 107 of 108 sound
# flights keep their name (drawn errors of one and of two tolerances; the largest gain was 0.8). The same is asked of
# what stands instead of the leader: without it `none` is named in 29 % of empty flights, with it in 47 % (seed 71000).
OTHER_FLOOR = 8.0
# Share of a shape's rms beyond what a listed mechanism reproduces, from which the shape is something else. The studies
# call an effect reproduced by what holds 90 % of it.
OUTSIDE = 0.1
ONE_STRETCH = 2  # times that a leader may change for one stretch: it begins and ends. With more, it may follow turns
# Share of the fall of 2 ln L that the leader brings which errors of second order (of motion and instruments, in its own
# columns) may leave: 1.4 % of its contribution's rms. On those 108 flights they leave less than shows, to falls of
# 22,000.
SECOND_ORDER = 2e-4
# The same for values: of the squares of errors (in tolerances) that the data ask of record and vehicle, and of the
# square of a coefficient, 7 % of itself. Not set by flights: it only keeps names from being refused.
SECOND_ORDER_VALUES = 5e-3
LEVEL_SIGMAS = 3.0  # standard errors of the noise's own level by which rates may be louder than it
# Probability of the errors that the data ask of record and vehicle, under their tolerances, below which the record is
# not what its tolerances say, or the flight too far from what is linear in them.
IMPROBABLE_ERRORS = 1e-4
BOUND_SIGMAS = 3.0  # standard errors by which a coefficient may lie outside its mechanism's bounds
COMPARED_BLOCKS = 8  # of time, of which each is held out in turn, if a user says nothing else
CRITERIA_TIE = 1e-6  # relative difference of residual sums of squares below which two subsets are equally good

# ---- Verdict: probability, limits ----

WINNING_PROBABILITY = 0.9  # posterior from which a hypothesis is named, or none adequate; convention that users quote
STANDING_PROBABILITY = 0.02  # posterior from which a rival stands beside the leader
OTHER_PRIOR = 0.2  # prior that something outside the list moved the vehicle (contract of `compare --json`)
# Widens the posterior for what the linearised likelihood does not know (second-order errors of motion and instruments).
# Set by the calibration of `brv-hypo study`, which tells the temperature of least log loss beside it, at 2, and at 1.5
# since the likelihood refines what stands; `tests.independent.study` has the calibration error that it leaves.
TEMPERATURE = 1.5
LIMIT_FALL = 2.71  # of 2 ln L, of a 95 % one-sided limit (chi-squared of one degree, 90 % two-sided)
LIMIT_EDGES = 9  # of regions that are tried: every region between two of them
CONFIDENCE_SIZE = 0.05  # of the test that drops a hypothesis from the model confidence set; convention
# Parts that the record is cut into for it, each held out once. Of six hypotheses as good as each other it keeps all in
# 0.91 (asked: 0.95), with 12 parts in 0.83, with 48 in 0.92 (tests/ranking/test_confidence_set.py).
CONFIDENCE_BLOCKS = 24
CONFIDENCE_DRAWS = 1000  # of blocks: p-values near 0.05 are known to 0.007
CONFIDENCE_SEED = 20111  # of those draws: the same record gives the same set; no result was sought by it
CONFIDENCE_TIE = 1e-6  # losses in 2 ln L that differ by less differ by rounding

# ---- Verdict: stability ----

REPETITIONS = (8, 12)  # numbers of blocks of which one is left out in turn, to see whether the same hypothesis leads
# Errors of what is told of vehicle and air, of which each is taken a tolerance higher and lower in turn for the same;
# in the loop too.
REPEATED_ERRORS = ("inertia", "inertia_ratio", "dynamic_pressure_scale")
KNOT_SHIFTS = (-0.5, 0.5)  # spacings by which all knots are moved, and refined again: no grid lies farther from another
REPEATED_WITHIN = 100.0  # criterion behind the leader up to which a rival's knots are moved: 3e-15 in probability
METHOD_SIGMAS = 3.0  # stated errors by which accelerometers may contradict another method before that has failed

# ---- Likelihood of what stands ----
# Held by `brv_hypo.identification.study`: how many converge, and how many intervals hold the truth.

LIKELIHOOD_STEPS = 8  # from a good regression 5 or 6 are enough, the record effects among its parameters, or none are
LIKELIHOOD_HYPOTHESES = 2  # the leader and its closest rival: a verdict compares no more
IDENTIFIED_STEPS = 30  # of `identify` alone, if a user says nothing else
IDENTIFIED_FORCE_DEGREE = 1  # Legendre degree of the normal-force slope in time, the same
IDENTIFIED_QUADRATURE = 0.2  # of the gyros' noise, that the spacing of nodes may cost, the same
IDENTIFIED_TOLERANCE = 0.1  # standard errors of the last step; it is taken, and what it leaves is of its square
# Change of any estimate, in standard errors and to first order, by other corrections of the block means, from which the
# fit is repeated; rounds of that.
IDENTIFIED_STALE = 0.1
IDENTIFIED_ROUNDS = 6
IDENTIFIED_CLOSE = 0.3  # standard errors of the last step: a search that stalled below is at its end but for knots
# Misfit of the start from which knots wait until the rest is near: a knot in an oscillating moment has several minima;
# steps with the knots held then: the first takes up what is linear, errors of the record above all.
IDENTIFIED_POOR_START = 2.0
IDENTIFIED_FIRST_STEPS = 2
IDENTIFIED_KNOTS_MOVED = 0.5  # blocks, by which a knot may have moved before the fit is repeated
IDENTIFIED_KNOTS_LOOSE = 0.25  # and standard errors: a knot that the data hardly tell goes to and fro with the nodes
# Blocks that a knot may move by in one step. Where the moment that it cuts off passes zero, the data hardly see the
# knot, and an unbounded step would throw it far.
IDENTIFIED_KNOT_REACH = 3.0
IDENTIFIED_FEWEST_NODES = 12  # of a segment
IDENTIFIED_LARGEST_BLOCK = 5  # samples from node to node
IDENTIFIED_PARTS = 16  # of what is between two nodes, at most
IDENTIFIED_TURN = 0.5  # rad that the meridian, or its rate times a delay, may turn by between two nodes

# ---- Loop: model, noise, candidates ----
# These and the next two sections were revised on seeds 171100 to 174044 of `tests.independent.loop_study`, and are held
# by its fresh ones; that a schedule comes first, by the measured entry (`brv_hypo.residuals.variants`).

TRACED_SMALLEST = 120  # samples from which a record is enough to hold any out
TRACED_KNOTS = 7  # as of a comparison, if a user sets none
TRACED_TERMS = 4  # the same
TRACED_STEPS = 8  # effects that may be added, if a user says nothing else
TRACED_SIGNIFICANCE = 0.01  # adjusted p-value below which an effect counts, the same
TRACED_BLOCKS = 32  # parts that the record is cut into, the same
HELD_OUT_OF = 4  # blocks, of which one is held out
HELD_OUT_BLOCK = 3  # which of them
HELD_OUT_SHORTEST = 8  # rows of a stretch that is fitted or held out
TRACED_SLOPE_DEGREE = 2  # of the scheduled stiffness in Mach number
TRACED_SPAN = (0.5, 99.5)  # percentiles that a quantity runs between
TRACED_SMALLEST_SPAN = 0.01  # of its greatest value; narrower, the polynomial is next to a constant
# Decades (rms) by which Reynolds number has to leave a smooth function of Mach number, of this degree, to be a quantity
# of its own.
TRACED_INDEPENDENT = 0.1
TRACED_SMOOTH_DEGREE = 3
NOISE_RAISED = 3  # times that the noise is raised to what the model leaves, which changes with it
MODEL_LINEARISATIONS = 2  # with what the tolerances allow taken out of the record
# Tolerances up to which an error is taken out: one that is larger is the misfit of a model that lacks something, and a
# record that is corrected by it is no longer the one that was flown.
MODEL_PLAUSIBLE = 3.0
MODEL_MOMENT_ROUNDS = 2  # of the in-plane moment that a delay looks back to, and of the columns that make it
MODEL_OWN_POINTS = 4  # linearisations about a model's own coefficients at most, while what is left falls
MODEL_CORRECTIONS = 2  # of the values of record effects, in the end
MODEL_TRIFLE = 1.01  # over the mean square before: 1 % is what noise moves it by
SCHEDULE_TRIFLE = 0.01  # of the static moment, below which a schedule's part of it is held to be none
RECORD_EFFECT_LARGEST = 30.0  # typical sizes that a record effect may have: the record would explain itself away
RECORD_EFFECT_CLOSER = 3  # turns about the best variant of the turn before
CANDIDATE_SOUND = 1.05  # error on left-out stretches that a fit may have, over that of its mechanism's best fit
CANDIDATES_LEFT_OUT = 8  # of which it is found what they explain on stretches left out, as many as a report shows
LOOK_AHEAD = 3  # candidates that are looked beyond
LOOK_AHEAD_RIVAL = 0.5  # of the leader's gain, that each must have: what explains far less is no rival
LOOK_ALIKE_NEAR = 10.0  # information that a look-alike may lack against the leader
LOOK_ALIKE_COSINE = 0.95  # between the predicted rates: 10 % of the square is left to tell them apart by
LOOK_ALIKE_GAIN = 0.8  # of the leader's gain, that such a one has to have
NEAR_EQUAL_COSINE = 0.95  # of an effect's prediction and the columns of another, from which that can take its place

# ---- Loop: description in generic terms ----

DESCRIBED_SCREENED = 10  # entries at most, of which the best subset is found exactly: 2^10 subsets
DESCRIBED_FINER = 5  # times by which each turn narrows the spacing of the places tried, as many to either side
DESCRIBED_CLOSEST = 0.02  # of the dictionary's spacing, at which that ends
# Entries at most that are tried as what begins, ends and jumps in time: the best over stretches that begin and end at
# so many equal parts of the record. As constants, what acts a quarter of it keeps a quarter of what it explains, and
# others come before it (tests.independent.descriptions).
DESCRIBED_TIMED = 3
DESCRIBED_STRETCHES = 8
DESCRIBED_CLIMB = 1.0  # fall of the sum of squares by which a neighbour has to explain more: as much as noise gives one
DESCRIBED_NEIGHBOURS = 1.5  # spacings within which two entries are one
DESCRIBED_FREE = 1e-4  # of a column's length, that the model has to leave of it
DESCRIBED_STEPS = 14  # places of a step, evenly over the quantity
# Widths of a step, of the way to the next place: where it is gradual, a sharp one leaves what several jumps in time
# would describe better.
DESCRIBED_SHARP = 0.1
DESCRIBED_GRADUAL = 0.3
DESCRIBED_SLOW = 1.0
DESCRIBED_HATS = 8  # places of a hat, each as wide as the way to the next
DESCRIBED_TERMS = 4  # at most, of what is described in the end

# ---- Loop: choice, findings and hints ----

LOOP_DETECTED = 25.0  # fall of the sum of squares at which an effect is detected: F of one coefficient
# Standard errors by which the held-out error has to fall: 5 %, one-sided. That the effect is no chance find among many
# was asked of the fitted part before.
HELD_OUT_SIGMAS = 1.645
# Standard errors by which the moments' error may grow where it need not fall: 5 %, one-sided, of Student's distribution
# for eight stretches held out. The noise of the gyros, differentiated, may drown it.
HELD_OUT_WORSE = 1.9
HELD_OUT_CLUSTER = 8  # rows that are summed before their squares are, so that short correlations count
# Share of the significance from which the fitted part leaves no doubt of an effect. A quarter of the record tells its
# size worse than three quarters do: that it is there, and lowers the error, is enough then. Where the residual passes
# for white nothing less counts: a test of whiteness asks for anything at all, and overlooks what the effect's own
# column shows.
LOOP_BEYOND_DOUBT = 1e-3
LOOP_TRIES = 3  # effects that may be tried on the held-out part in one step
LOOP_IN_ITS_PLACE = 0.5  # of a refused one's gain in the fitted part: what explains far less does not replace it
# Share of what the best explains from which a schedule comes before it: a slope that changes along an entry is first of
# all a function of Mach number, and jumps in time describe any smooth change.
LOOP_SCHEDULE = 0.5
# Share of what changes in time of each of several flights explain, from which one description that all share comes
# before them: a step in Mach number explained 0.95 and more, jumps in time 0.51 (tests.independent.two_flights).
LOOP_SHARED = 0.8
LOOP_REPEATED_BLOCKS = (0.75, 1.25)  # of the configured number
LOOP_REPEATED_KNOTS = (-2, 2)  # added to it: a third of the usual seven, so that regions fall elsewhere
LOOP_RIVALS = 5  # that are fitted again: the best few of those that save anything
FINDING_SIGMAS = 1.645  # standard errors by which a finding lowers the held-out moment error: 5 %, one-sided
FINDING_REPEATED = 0.75  # share of the repetitions that name it: three in four
FINDING_SHOWN = 12.0  # fall of the squared whitened rates above which an effect shows in the moments
WHITE_LAGS = 20  # samples, of the test of whiteness (Ljung and Box, Biometrika 65:297, 1978)
WHITE_CHANCE = 0.05  # p-value above which what is left is called white; convention
TOLD_CHANCE = 0.01  # p-value, adjusted for the channels tried, below which a correlation is told; convention
TOLD_REGIONS = 16  # stretches of time, of which the worst and its neighbours are told
TOLD_REGION_SHARE = 0.5  # of the worst, that its neighbours have
TOLD_FREQUENCY_LINES = 1.5  # of the spectrum, within which a frequency is a multiple of roll or meridian rate
TOLD_FREQUENCY_WITHIN = 0.1  # or of itself
TOLD_PER_CYCLE = 25.0  # samples; a mean over the interval reads 0.3 % too small there, 1 - sinc(1 / 25)
TOLD_MERIDIAN = 90.0  # percentile of the meridian's rate that is the fastest motion
TOLD_SLOPES = 32  # places along a flight at which the static slope is told
STABLE_SIGMAS = 2.0  # standard errors by which a static slope must be stable to be told so; convention
TOLD_DRAG = 0.1  # relative spread of axial force over dynamic pressure, below which they are said to be one

# ---- Prediction ----
# Held by `tests.independent.sisters`: what the frozen model explains, and what its band holds.

BAND_SIGMAS = 1.96  # standard deviations on either side of the prediction
BAND_LEVEL = 0.95  # share of a normal distribution between them
BAND_LEAST_NOISE = 0.1  # share of the noise that a fit leaves at least
BAND_FREQUENCIES = 2048  # up to half the sample rate, that the noise of moments is summed over
MODEL_ERROR_WEIGHTS = (0.25, 0.5, 0.25)  # of a held-out stretch and its neighbours in Mach: one holds few cycles
MODEL_ERROR_CHANCE = 0.05  # that noise alone leaves as much on any held-out stretch of a flight
PREDICTED_BLOCKS = 8  # at least, of the record's: the fewest that a trace may be told to cut it into
PREDICTED_LINEARISATIONS = 2  # where errors of the record are fitted
PREDICTED_NEARLY_ALL = 0.995  # share of the samples where the model's flights flew, from which nothing is said of it
# Share of the frozen model's mean square, noise aside, below which letting record and vehicle err is worth a word; and
# the share of the moments' mean square below which the frozen model's is small enough to need none.
PREDICTED_GREATLY = 0.5
PREDICTED_SMALL = 0.01
PREDICTED_HOLDS = 0.90  # of the samples within a 95 % band, below which the model errs by more than it said
PREDICTED_TELLING = 0.25  # of the noise's mean square, from which what a model left where it was found is told
# Where slope or damping differ from a frozen model's: a study of its own, `tests.independent.sisters --changed`.
CHANGE_EDGES = 25  # times, evenly over the record, between any two of which they may: 300 regions
CHANGE_FINER = 4  # times by which each turn narrows the spacing about the best two, as many to either side
CHANGE_ROUNDS = 2  # turns: 1/16 of the spacing, which is less than what the data tell of an edge
CHANGE_CHANCE = 0.01  # p-value, paid for all that is tried, below which a change is told; convention
