"""What reconstruction, search and likelihood go by, and how far they go, in the order in which data flow.

Beside each stands what it is of and why it is as it is; over each section the studies that its constants were set by,
or whose figures (brv_hypo/docs/validation.md) hold with them. A constant that names no source or study of its own was
set by judgement.

Not here: thresholds that decide a fault, a name or a finding (`brv_hypo.thresholds`); steps of a search that one module
alone takes, which stand at its top; and what guards arithmetic (rounding, ridges,
cutoffs near machine precision), bounds memory or time, or is drawn or listed.
"""

from __future__ import annotations

# ---- Motion: filters, smoothing, the fit of forces and rates ----
# Held by `tests.motion.study` and `tests.studies.independent.study`: errors of angles and moments against those stated.

RESPONSE_TURN = 1e-5  # rad, half the width of differences by the start's direction
RESPONSE_PULL = 5e-3  # m/s^2, the same by gravity
MOMENT_SLOPE_STEP = 1e-6  # of a quantity, or of its unit where that is more, half the width of a moment's slope by it

# ---- Priors of the model, and the time that flights share ----
# Judgement about bodies, that of the schedule after results on the measured entry had been seen; held by
# `tests.studies.independent.study --drawn`, whose bodies bend, by `tests.studies.independent.loop_study`, and, of
# common time, by `tests.studies.independent.joint` and `tests.studies.independent.two_flights`.


# ---- Regression: noise of the rows ----
# Held by `tests.studies.independent.study --coloured` (half of its flights in noise that lasts) and
# `tests/studies/independent/test_coloured_noise.py`.

FORCE_SPIKE = 7.2  # residuals of the normal force, in their median, from which a sample is a spike
FORCE_SPIKE_ROUNDS = 2  # of the force's fit without spikes
WALK_FEWEST_MODES = 10  # sines of the attitude's random walk
WALK_MOST_MODES = 80  # bounds the time
# Sines for each cycle of the motion. A walk at frequency f turns the vehicle by the static moment, which is (f_n / f)^2
# of the noise that the walk is made of: half as fast again as the motion, with two sines a cycle, it is lost in it.
WALK_MODES_PER_CYCLE = 3.0
WALK_LEFT_OUT = 0.8  # standard deviations of alpha, of what the sines may leave of the walk
NOISE_MOST_EQUAL = 0.995  # of a direction's noise, that goes to unknowns: what is left keeps the rows regular
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
# Bound the time; held by `tests.studies.independent.study` (how often the truth wins where the ideal-observer
# bound separates it from rivals).

COMPARED_KNOTS = 11  # where coefficients may change, if a user sets none
COMPARED_TERMS = 6  # columns that a hypothesis may add, if a user says nothing else
COMPARED_EXACT_TERMS = 4  # up to which the search is exact, the same
SEARCH_PATIENCE = 2  # sizes that may go by without a gain before the search over sizes ends
# A hypothesis whose criterion stays this far (twice ln L) behind another after so many terms is not searched further.
SEARCH_OUT_OF_REACH = 400.0
SEARCH_SIZES_TRIED = 3
SEARCH_SAME_THETA = 0.1  # relative difference up to which two values are one, found twice (refined at two knots)
SCANNED = 7  # values of a parameter that are tried before Gauss-Newton
SCANNED_FACTOR = 1.6  # of a theta either way
# Half the width of differences by knots and delays, of their bounds; steps at most, and the gain in 2 ln L below which
# they end. Of models that are compared: a tenth of what one term costs.
REFINED_WIDTH = 2e-3
REFINED_STEPS = 6
REFINED_GAIN = 0.2
# Fall of 2 ln L by which one model has to beat another to take its place, more than steps and rounding leave.
SEARCH_GAIN = REFINED_GAIN
SEARCH_EQUAL = 1e-3  # of 2 ln L, within which the first that was found is taken
REFINED_HALVINGS = 4  # lengths of a step that are tried
# Of one that is reported, or linearised about.
REFIT_STEPS = 40
REFIT_GAIN = 1e-6
CONSISTENT_ROUNDS = 4  # refits in which C_mw and what follows it come to agree
# A moment that turns in the body: rates tried at most, half to either side (beyond half a turn a record apart they are
# independent), and times the motion's own (roll, and the meridian's in nine tenths of the time) up to which it turns.
TURNING_RATES = 160
TURNING_FASTEST = 3.0
TURNING_MERIDIAN = 90.0  # percentile of the meridian's rate

# ---- Verdict: linearisation, baseline ----
# These and the next three sections were worked out on the seeds of `tests.studies.independent.study` that
# validation.md lists, and are judged together by its fresh ones.

COMPARED_SMALLEST = 60  # samples; rule of thumb: four for each of baseline and six terms
# Probability that the largest of a result's errors of record and vehicle, each drawn at its tolerance, is named as
# beyond it (one flight has 53 of them, and beyond 3 tolerances is one in 7 of such flights); how many are named.
BEYOND_CHANCE = 0.01
BEYOND_NAMED = 3
FAR_BETTER = (
    0.25  # of a held-out error: below it, on several flights, a rival is said to predict far better; wording alone
)
# Sigma that the instruments' noise shows at the motion's frequency, over that of neighbouring samples, from which the
# motion is reconstructed with it: correlations of neighbouring samples above 0.2.
COLOURED = 1.5
# Fall of the criterion by which the leader beside processes has to be likelier than the search had it, from which on
# the search is taken to have missed it: 10 nats.
SEARCH_MISSED = 20.0
OFFSET_DEGREE = 1  # Legendre degree in time of the drift of C_m0
SLOPE_DEGREE = 3  # and of that of C_malpha: a speed that falls by a tenth bends it beyond a parabola

# ---- Verdict: adequacy, what is outside the list ----

# Share of a shape's rms beyond what a listed mechanism reproduces, from which the shape is something else. The studies
# call an effect reproduced by what holds 90 % of it.
OUTSIDE = 0.1
# Errors of second order in values: of the squares of errors (in tolerances) that the data ask of record and vehicle,
# and of the square of a coefficient, 7 % of itself. Not set by flights: it only keeps names from being refused.
SECOND_ORDER_VALUES = 5e-3
COMPARED_BLOCKS = 8  # of time, of which each is held out in turn, if a user says nothing else

# ---- Verdict: probability, limits ----

WINNING_PROBABILITY = 0.9  # posterior from which a hypothesis is named, or none adequate; convention that users quote
CREDIBLE_PROBABILITY = 0.02  # posterior from which a rival stands beside the leader
OTHER_PRIOR = 0.2  # prior that something outside the list moved the vehicle (contract of `compare --json`)
LIMIT_FALL = 3.84  # of 2 ln L: the upper end of a 95 % interval (chi-squared of one degree), and its quantile
LIMIT_QUANTILE = 0.975
LIMIT_LARGEST = 10.0  # rms moments above which nothing is known of a mechanism's size
LIMIT_PART = 0.25  # of the record, for which a mechanism acts whose coefficients are limited too
LIMIT_EDGES = 9  # of regions that are tried: every region between two of them

# ---- Repetitions of a trace ----


# ---- Likelihood of what stands ----
# Held by `tests.studies.identification.study`: how many converge, and how many intervals hold the truth.

LIKELIHOOD_STEPS = 8  # from a good regression 5 or 6 are enough, the record effects among its parameters, or none are
LIKELIHOOD_HYPOTHESES = 2  # the leader and its closest rival: a verdict compares no more

# ---- Loop: model, noise, candidates ----
# These and the next two sections were revised on seeds 171100 to 174044 of `tests.studies.independent.loop_study`, and
# are held by its fresh ones; that a schedule comes first, by the measured entry (`tests.studies.loop.variants`).

HELD_OUT_OF = 4  # blocks, of which one is held out
HELD_OUT_BLOCK = 3  # which of them
HELD_OUT_SHORTEST = 8  # rows of a stretch that is fitted or held out
NOISE_RAISED = 3  # times that the noise is raised to what the model leaves, which changes with it

# ---- Loop: description in generic terms ----


# ---- Loop: choice, findings and hints ----

REPORTED_SLOPES = 32  # places along a flight at which the static slope is told
# Of the change that a bend (alpha^2) makes of a slope from alpha = 0 to the greatest angle flown, the share below the
# least angle flown, which no sample shows, beyond which a value at alpha = 0 is an extrapolation; convention.
EXTRAPOLATED_SHARE = 0.05
INFLATED, COLLINEAR = 10.0, 0.9  # variance inflation, correlation: Belsley, Kuh and Welsch, 1980, 3.2; convention

# ---- Prediction ----
# Held by `tests.studies.independent.sisters`: what the frozen model explains, and what its band holds.
