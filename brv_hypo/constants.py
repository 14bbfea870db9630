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

# Standard deviation of the slope's change along Mach numbers, over its mean, and the ratio of Mach numbers, as a
# logarithm, over which it changes: blunt and slender shapes change by such shares within a doubling.
SCHEDULE_RELATIVE = 1.0

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
# Share of the speed by which it may depart from such a polynomial before C_malpha follows it too: stiffness follows
# Mach number about in proportion, and a change of it of a few parts in ten thousand of the moment is not seen.
WAVERING_SPEED = 5e-5

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

# Errors of vehicle and air, of which each is taken a tolerance higher and lower in turn.
REPEATED_ERRORS = ("inertia", "inertia_ratio", "dynamic_pressure_scale")

# ---- Likelihood of what stands ----
# Held by `tests.studies.identification.study`: how many converge, and how many intervals hold the truth.

LIKELIHOOD_STEPS = 8  # from a good regression 5 or 6 are enough, the record effects among its parameters, or none are
LIKELIHOOD_HYPOTHESES = 2  # the leader and its closest rival: a verdict compares no more

# ---- Loop: model, noise, candidates ----
# These and the next two sections were revised on seeds 171100 to 174044 of `tests.studies.independent.loop_study`, and
# are held by its fresh ones; that a schedule comes first, by the measured entry (`tests.studies.loop.variants`).

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
MODEL_TRIFLE = 1.01  # over the mean square before: 1 % is what noise moves it by
FAMILY_SPLINES = 12  # of each shape of a process of moments, at least, where families are compared: as of the damping
RECORD_EFFECT_LARGEST = 30.0  # typical sizes that a record effect may have: the record would explain itself away
RECORD_EFFECT_CLOSER = 3  # turns about the best variant of the turn before
CONFOUNDED_NEAR = 10.0  # information that a look-alike may lack against the leader
CONFOUNDED_GAIN = 0.8  # of the leader's gain, that such a one has to have

# ---- Loop: description in generic terms ----

DESCRIBED_FINER = 5  # times by which each turn narrows the spacing of the places tried, as many to either side
DESCRIBED_CLOSEST = 0.02  # of the dictionary's spacing, at which that ends
DESCRIBED_EDGES = 17  # times, evenly over the record, between any two of which what is described may act
DESCRIBED_STEPS = 14  # places of a step, evenly over the quantity
# Widths of a step, of the way to the next place: where it is gradual, a sharp one leaves what several jumps in time
# would describe better.
DESCRIBED_SHARP = 0.1
DESCRIBED_GRADUAL = 0.3
DESCRIBED_SLOW = 1.0

# ---- Loop: choice, findings and hints ----

LOOP_DETECTED = 25.0  # fall of the sum of squares at which an effect is detected: F of one coefficient
# Standard errors by which the held-out error has to fall: 5 %, one-sided. That the effect is no chance find among many
# was asked of the fitted part before.
HELD_OUT_SIGMAS = 1.645
# Standard errors by which the moments' error may grow where it need not fall: 5 %, one-sided, of Student's distribution
# for eight stretches held out. The noise of the gyros, differentiated, may drown it.
HELD_OUT_WORSE = 1.9
HELD_OUT_CLUSTER = 8  # rows that are summed before their squares are, so that short correlations count
# Share of the significance from which an effect counts where the residual passes for white: a test of whiteness asks
# for anything at all, and overlooks what the effect's own column shows.
LOOP_BEYOND_DOUBT = 1e-3
LOOP_TRIES = 3  # effects that may be tried on the held-out part in one step
LOOP_IN_ITS_PLACE = 0.5  # of a refused one's gain in the fitted part: what explains far less does not replace it
# Share of what the best explains from which a schedule comes before it: a slope that changes along an entry is first of
# all a function of Mach number, and jumps in time describe any smooth change.
LOOP_SCHEDULE = 0.5
LOOP_REPEATED_BLOCKS = (0.75, 1.25)  # of the configured number
LOOP_REPEATED_KNOTS = (-2, 2)  # added to it: a third of the usual seven, so that regions fall elsewhere
LOOP_RIVALS = 5  # that are fitted again: the best few of those that save anything
FINDING_SIGMAS = 1.645  # standard errors by which a finding lowers the held-out moment error: 5 %, one-sided
FINDING_REPEATED = 0.75  # share of the repetitions that name it: three in four
HINT_REPEATED = 0.5  # below which another effect explains the record as well: no name then
WHITE_LAGS = 20  # samples, of the test of whiteness (Ljung and Box, Biometrika 65:297, 1978)
WHITE_CHANCE = 0.05  # p-value above which what is left is called white; convention
REPORTED_REGIONS = 8  # parts of a record, of which the worst is told
REPORTED_SLOPES = 32  # places along a flight at which the static slope is told
STABLE_SIGMAS = 2.0  # standard errors by which a static slope must be stable to be told so; convention
# Of the change that a bend (alpha^2) makes of a slope from alpha = 0 to the greatest angle flown, the share below the
# least angle flown, which no sample shows, beyond which a value at alpha = 0 is an extrapolation; convention.
EXTRAPOLATED_SHARE = 0.05
INFLATED, COLLINEAR = 10.0, 0.9  # variance inflation, correlation: Belsley, Kuh and Welsch, 1980, 3.2; convention
REPORTED_DRAG = 0.1  # relative spread of axial force over dynamic pressure, below which they are said to be one

# ---- Prediction ----
# Held by `tests.studies.independent.sisters`: what the frozen model explains, and what its band holds.

BAND_SIGMAS = 1.96  # standard deviations on either side of the prediction
BAND_LEVEL = 0.95  # share of a normal distribution between them
BAND_LEAST_NOISE = 0.1  # share of the noise that a fit leaves at least
BAND_FREQUENCIES = 2048  # up to half the sample rate, that the noise of moments is summed over
MODEL_ERROR_CHANCE = 0.05  # that noise alone leaves as much on any held-out stretch of a flight
PREDICTED_BLOCKS = 8  # at least, of the record's: the fewest that a trace may be told to cut it into
PREDICTED_LINEARISATIONS = 2  # where errors of the record are fitted
PREDICTED_NEARLY_ALL = 0.995  # share of the samples where the model's flights flew, from which nothing is said of it
# Share of the frozen model's mean square, noise aside, below which letting record and vehicle err is worth a word; and
# the share of the moments' mean square below which the frozen model's is small enough to need none.
PREDICTED_GREATLY = 0.5
PREDICTED_SMALL = 0.01
PREDICTED_HOLDS = 0.90  # of the samples within a 95 % band, below which the model errs by more than it said
PREDICTED_DISTINCT = 0.25  # of the noise's mean square, from which what a model left where it was found is told
# Where slope or damping differ from a frozen model's: a study of its own, `tests.studies.independent.sisters
# --changed`.
CHANGE_EDGES = 25  # times, evenly over the record, between any two of which they may: 300 regions
CHANGE_FINER = 4  # times by which each turn narrows the spacing about the best two, as many to either side
CHANGE_ROUNDS = 2  # turns: 1/16 of the spacing, which is less than what the data tell of an edge
CHANGE_CHANCE = 0.01  # p-value, paid for all that is tried, below which a change is told; convention
