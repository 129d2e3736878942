"""Every constant of the diagnosis: name, value, unit, why.

First come those that decide what is found, how probable it is and whether it is written. Then come
those that affect only figures and wording, bound the work, or keep the arithmetic defined. `1` is a
ratio or a probability, `σ` a number of standard uncertainties, `nat` natural logarithms of a
probability. Constants of a single cause are in `effects/`. The effect of halving and doubling each
of the first ones on frozen cases is in docs/developer/constants.csv.
"""

from __future__ import annotations

import math

# --- What decides -------------------------------------------------------------------------------

# Significance, and names of causes
ALPHA = 0.01  # 1; family-wise false-alarm rate on clean data
CLEARLY = 10.0  # 1; odds from which another name is clearly likelier (Jeffreys: strong)
AS_WELL = 10.0  # nat; a cause or set that is less likely by up to so much still explains as well
UNKNOWN_PRIOR = 0.05  # 1; prior probability of causes that are not in the catalogue
EXPECTED_PRIOR = 0.5  # 1; what no calibration could know and every arm may have: as likely as not
FURTHER_ODDS = 0.2  # 1; prior odds that one more cause is there beside those found
SHAPE_PRIOR = 0.5  # 1; that a strong finding's shape is off: as likely as not
#: 1; a cause that explains less of what depends on its variables is a guess. A disc whose shape is
#: off by 30 % explains 0.92, one whose shape is off by half 0.8.
ENOUGH = 0.8
LEAST_PART_SHOWN = 0.005  # 1; a part of the readings with less of the cause's signal gives no size
LEAST_PROBABILITY = 0.01  # 1; an alternative, or a set of causes, less probable is not reported
MOST_RIVAL_SET = 0.5  # 1; a set that has not replaced the findings is at most as probable
ABSORBED = 1e-6  # 1; a candidate that keeps less of its squared norm in projection is absorbed
LEAST_EXPLAINED_SHARE = 0.25  # 1; a candidate that explains so much of another may be the true one
#: columns; with more, such as the many small steps of a walk, χ² counts mostly noise. There the
#: Bayes factor also counts: by chance it exceeds B at most once in B cases (Markov).
MOST_COUNTED = 12
MOST_FREE_COLUMNS = 6  # columns; with more, the amplitudes share one likely size
MOST_LEVERAGE = 0.9  # 1; a rest that decides so much of an amplitude leaves no residual to judge by
MOST_GAINED = 2.0  # 1; unclipping gains hardly more than this times what was clipped
#: nat; from about nine noise units on, the likeliest kinds are compared with outliers clipped about
#: each one's own fit, and causes are tried with another shape.
STRONG = -40.0
MOST_FINDINGS = 10  # causes; an arm with more is wrong in a way that no diagnosis sorts out
MOST_IN_PLACE = 3  # causes; one finding stands for two or three
CONTRADICTED = 1.0  # σ; a likelier set counts unless held-out readings contradict it by so much
BEYOND_CHANCE = 1.0  # σ; the held-out gain by which causes that explain why replace a walk in time

# Shape and size of a cause
SHAPE_OFF = 0.15  # 1; standard deviation of each harmonic's share, RMS over the turn
SHAPE_ORDERS = (1, 2)  # 1/turn; the harmonics of a shape that is off
CURVE_SCALE = 3.0  # 1; a curve's first likely size, over the catalogue's, before it is fitted
CURVE_SCALES = (0.3, 100.0)  # 1; limits of the fitted size (empirical Bayes)
LEAST_UNEVEN = 0.5  # noise units over all readings; a discrepancy that shows less is left out
#: 1; expansion that makes less than this times the residual does not stand out: a disc far off its
#: axis left 22 µm, possible expansion made 22, and the true one, 13, did not justify a term.
STANDS_OUT = 2.0
#: σ; a certified length may miss by so much more than before by chance: one of a dozen is near its
#: limit
CLEARLY_MORE = 1.0
OF_THEIR_OWN = 0.05  # 1; if the model's terms leave less of a finding (length), it is their change
LEAST_ABSORBED = 1.0  # noise units; a direction that shows less at its plausible limit is not used
GAUGE = {"mm": 1.0, "rad": 2e-3}  # mm, rad; uncertainty of undetermined constants
PER_KELVIN = 0.1  # 1/K; the same for the slope of a term, as a share of GAUGE

# Noise
GROSS = 4.0  # 1; mean over median squared residual with gross errors (Student's t of 3: 2 to 3)
KNOT_S = 450.0  # s; slow drift is a random walk between knots so far apart
USUAL_DRIFT = 0.3  # 1; the first estimate of the drift, as a share of the noise
FAR_LIKELIER = 10.0  # −2 log likelihood; another start is taken where it is likelier by so much
CORRELATION_SIGMAS = 5.0  # σ; a correlation is significant: one in a million independent sets
MOST_CORRELATION = 0.9  # 1; a larger one is not noise but a drift
LEAST_CORRELATION = 0.01  # 1; a smaller one has no weight
LONGEST_GAPS = 3.0  # usual gaps; rests farther apart show nothing of a correlation
#: 1; the noise of one search is not larger than another's up to this ratio. False causes made it
#: smaller by 8 %, lost ones larger by a factor of 5.8.
AS_QUIET_AGAIN = 1.25
AS_QUIET_GROWN = 1.02  # 1; noise that is larger by no more counts as equal, for links' expansion

# Groups of readings, and moved artefacts
REST_RAD = 1e-4  # rad; readings closer in every joint, in sequence at one target, are one rest
PAUSE = 10.0  # usual gaps; a longer gap between readings is a pause
LEAST_SPAN_K = 0.05  # K; a temperature that varies by less counts as constant
MOST_TELL = 0.5  # 1; a column counts as present if more of the readings have it
POSE_TARGETS = 3  # targets; so many determine a pose and no more
LEAST_RESTS_BESIDE = 4  # rests; needed before and after a step to show where an artefact stood
LEAST_TARGETS = 2  # targets among them; one alone does not show whether it or the arm moved
MOST_MOVED = 6  # moves of the artefact; more have another cause than an occasional touch
AS_FAR_OFF = 3.0  # 1; limit of an explained session's median reading, over the others' median

# Decisions by held-out readings
IN_ONE = 0.75  # 1; a share that shows in one fold so large that the others cannot determine it
MOST_SQUARES = 15.0  # usual squared residuals; limit of a gross error: six noise units
MOST_WORSE = 0.02  # 1; gross errors change the overall error by less: beyond it a finding harms
CHANGED_PRIOR = 0.05  # 1; that the arm had changed when the other readings were taken

# --- What is only shown and worded: changes no finding, no probability, nothing written ---------

SURE = 0.95  # 1; a finding less probable is worth an experiment of its own
LEAST_WORTH_EXCLUDING = 1e-4  # 1; many less probable ones together can keep a finding in doubt
INDISTINGUISHABLE_P = 0.01  # 1; with such an alternative the finding adds nothing significant
STEP_P = 1e-3  # 1; chance that noise makes any step of a target
LEAST_PART = 3  # rests; so many have a mean that shows where a target stood
BEYOND_NOISE = 1.5  # 1; residuals so many times the noise's RMS are more than noise
HALF_WIDTH = 1.96  # standard deviations; the pointwise band that holds 95 % of all data sets
BEYOND = 0.05  # 1; the share of data sets outside that band
BEYOND_FLAT = 10.0  # 2 Δ ln L; a varying curve must explain so much more than a constant one
SHARE_BEYOND = 0.1  # 1; and more than it by this share
BEYOND_VALUES = 10.0  # 2 Δ ln L; a grouping by name must explain so much more than one by value
SHARE_OF_NAMES = 0.05  # 1; and more than it by this share
LEAST_VARIANCE_SHARE = 1e-5  # 1; a direction with less of its variance left is absorbed
#: sessions; fewer do not show how sessions scatter: placements are used instead
LEAST_SCATTERED = 3
SIZE_SIGMAS = 2.0  # σ; a size is known if it is so many times its uncertainty
#: 1; an uncertainty so many times the value: the readings do not determine it
UNDETERMINED_TIMES = 1e3
WOULD_SHOW = 5.0  # noise units; a larger cause is mostly detected
LEAST_SPARE = 30  # numbers; with fewer spare ones the noise is unknown
FAR_TIMES = 100.0  # 1; readings so many times farther off than the median one are no tail
MOST_TOLD = 3  # rows; so many of those are listed
MOST_PARTS = 40  # sessions, placements, targets; a longer list is no help

# --- What bounds the work: grids, rounds, draws, groups -------------------------------------------

# The search
MOST_SEARCH_STEPS = 16  # steps; ten findings, and some renamed or refused
MOST_RENAMINGS = 3  # times; a name that changes three times goes in a circle
MOST_FIRST = 6  # causes tried first in the place of one that can follow anything in time
MOST_RIVALS = 8  # alternatives reported, and weighed with their own shapes
MOST_COMPARED = 20  # alternatives compared
MOST_EXPLAINING = 6  # causes that may explain a session which does not fit the others
MOST_REFINED = 5  # places whose grids are refined before they are compared
MOST_RICHER = 3  # general bases made richer: one that always competes absorbs several causes
MOST_AT_ONCE = 64  # values scored at once; of more, some come first
MOST_ALIKE = 12  # kinds compared with outliers clipped about their own fits
MOST_BENT = 8  # causes tried with another shape
MOST_REPEATED = 2  # searches repeated without refuted findings
MOST_GROWTH_ROUNDS = 10  # rounds over all links; three are enough in practice
RANGE_PARTS = 8  # parts, with equally many rests, of a variable's range and of the time
STEP_WORK = 1.0  # scores of the catalogue that one step of the search costs, with its fits
TRIAL_WORK = 0.3  # the same for a set tried instead of another
REPEATED_WORK = 0.4  # the same for a step of the repeated search
MOST_PRODUCTS = 40e6  # products of candidates' and shared columns; about 1e6 take a second
MANY_READINGS = 2000  # readings; with fewer the bound is higher, because a score costs less
MOST_TIMES = 4.0  # 1; the bound is higher by at most this factor
MOST_OF_SETS = 0.4  # 1; the share of the work that other sets may take
LEAST_REPEATED = 0.3  # 1; the share reserved for the repeated search
ROWS_A_COLUMN = 60.0  # rows that count as one shared column in the work of scoring
MOST_INSTANTS = 40  # instants at which something may have stepped: the first, coarse grid
MOST_SPELLS = 8  # spells between pauses
TOUCHED_GRID = 12  # instants in a placement on the first, coarse grid
TOUCHED_FINER = 100  # parts of a placement tried at once
REWEIGHTINGS = 8  # rounds of reweighting, of a pose and of a candidate
LEAST_GAINED = 0.01  # nat; a round that gains less was the last

# The fit
CURVED_SHARE = 0.1  # 1; of the noise: a step with a larger error is linearised again
CURVED_LENGTH_MM = 200.0  # mm; a step's error is about its square over this
MOST_FIT_STEPS = 6  # steps
SIZING_STEPS = 6  # steps that find a curve's size
MOST_CLIPPINGS = 10  # first estimates of the noise, with gross errors clipped
NOISE_SETTLED = 0.9  # 1; the estimate has settled when it falls by less than a tenth
SHARED_ALIKE = 0.05  # 1; and when the part that copies of a posture share changes by no more
STAYS = 0.1  # σ; a solution that changes by less has converged
MOST_FOLLOW_ROUNDS = 30  # rounds; three to six suffice, but a curved valley needs shorter steps
MOST_TURNS = 5  # alternating fits; two suffice, and one that does not settle is taken as it is
COLUMNS_CHANGED = 0.01  # 1; columns are rebuilt where amplitudes changed by more
TURN_SETTLED = 0.05  # log; the ratio of orientation to point noise settled if it changes by less
TURN_RATIOS = 1e-4, 1e4  # 1; limits of that ratio
SLOPE_STEP = 0.02  # 1; relative step to either side for a signature's slope
CURVE_POINTS = 360  # points over the turn: more than ten for the shortest period
SEEN_POINTS = 3  # points to either side of an angle measured
LEFT_OUT_PARTS = 24  # parts of rests left out: about as many as a calibration has constants
WALK_RANGE = 1.6  # 1; range of a walk over the deviation of its end (Feller 1951: √(8/π))
MOST_FUNCTIONS = 40  # functions of a walk: m leave 1/(π² m) of its variance; sessions need several
WALK_MOMENTS = 160  # moments at which the walk's covariance is taken
CORRELATIONS_TRIED = (0.3, 0.5, 0.65, 0.8)  # 1; between them, and up to the largest, interpolated
MOST_MEMORY_RESTS = 400  # rests of a placement; with more, too little is absorbed to hide a memory

# The noise
MOST_KNOTS = 8  # knots of the drift in a session
LEAST_DRIFT_ROWS = 6  # readings; fewer do not show a drift
MOST_ROBUST = 12  # fits with gross errors clipped
MOST_DRIFT = 1e3  # 1; beyond it the products of columns contain nothing of the noise any more
NOISE_SCALES = (1.0, 0.1, 0.01, 0.001)  # 1; starting values
NOISE_DRIFTS = (0.03, 0.3, 3.0, 30.0, 300.0)  # 1; starting values, over the noise
SCALE_STEPS = (0.1, 0.5)  # log; first steps of scale and drift
NEAR_SCALE_STEPS = (0.01, 0.05)  # log; the same, from the values at a similar share
LEAST_DRIFT = 1e-4  # 1; a start, over the noise: none is visible
SCALE_SETTLED = 0.02  # log; both have settled if they change by less
MOST_EVALUATIONS = 400  # evaluations; most searches settle within 40
SAME_SCALE = 0.05  # log; certified lengths are weighted by a scale so near to the one found
MOST_SCALES = 6  # rounds until that holds
LEAST_ENCODER_SHARE = 0.01  # 1; smallest share of the noise from encoders that is tried
MOST_ENCODER_SHARE = 0.99  # 1; largest share
NEAR_SHARE = 0.15  # 1; half width of the range about a share found before
SHARE_SETTLED = 0.03  # 1; tolerance of the share
FIRST_SHARE_STEPS = 7  # evaluations
NEXT_SHARE_STEPS = 3  # evaluations, where a share was found before
LEVER_MM = 500.0  # mm; rough distance from a joint to the tip, which turns a scatter into an angle

# Readings held out, drawn and resampled
MOST_FOLDS = 4  # parts of placements left out in turn
BLOCKS = 5  # parts of readings, where there is one placement only
TARGET_FOLDS = 4  # parts of targets
TIME_PARTS = 4  # parts of the time
KNOWN_PARTS = (2, 3)  # parts; the parts after so many are predicted from those before
TRUTH_BLOCKS = 40  # blocks of readings with their own truth: only time groups them
RESAMPLES = 1000  # sets of groups
WIDEST_DEG = 10.0  # °; no bin of an angle is wider
MOST_BINS = 36  # bins of equal count
LEAST_BIN_RESTS = 8  # rests in each
LEAST_BINS = 2  # bins; fewer show nothing
WAVES = 20  # waves per turn at most: a wheel's few teeth, a bearing's rollers
INSEPARABLE = 0.9  # 1; squared correlation of variables that readings cannot separate
SHORTEST_MM = 20.0  # mm; a shorter link has no component of its own
CURVES = 50_000  # curves for a small p-value: the least of 700 must be below 0.05 / 700
CURVES_AT_ONCE = 500  # curves that a cache holds
ENOUGH_CURVES = 100  # curves outside: they determine a p-value to a tenth of itself
LEAST_CORRELATED = 1e-6  # 1; variance in each direction, over that of a bin
CURVES_SEED = 0xC0E  # seed of their random numbers
MOST_TOGETHER = 120  # sums with a full covariance; more count as independent
SETS_SHOWN = 12  # data sets drawn to be shown
#: features of each shape, by the kind of a variable
SHAPES_BY_KIND: dict[str, tuple[int, ...]] = {
    "angle": (3, 5, 6), "rate": (2, 3, 4), "temperature": (2, 3, 4), "time": (2,)
}  # fmt: skip

# --- What keeps the arithmetic defined, and how it is laid out ------------------------------------

AXES = 3  # directions of space: the equations of a point
PAIRS_CHUNK = 256  # pairs of basis functions at once
PAIRS_PIECE = 1024  # rests at once: what stays in the processor's cache
SIGNATURES_PIECE = 512  # rests at once
MANY_INDICES = 1 << 20  # more than there are parameters, or basis functions
EVENLY = 1.0 / math.sqrt(12.0)  # 1; standard deviation of a uniform distribution of width one
RIGHT_ANGLE_DEG = 90.0  # °; between a signature and an empty one
LEAST_POSITIVE = 1e-300  # 1; replaces zero in a divisor
LEAST_SQUARE = 1e-12  # the same for sums of squares
LEAST_SUM = 1e-30  # the same for variances of sums
LEAST_VARIANCE_MM2 = 1e-14  # mm²; the least variance that is inverted
TINY_MM2 = 1e-18  # mm²; the least variance in a comparison
LEAST_MM = 1e-6  # mm; no reading is better than a nanometre, even where everything is absorbed
LEAST_SIZE_MM = 1e-3  # mm; the least size by which others are divided
LEAST_APART_S = 1e-3  # s; least time between readings for a speed
ROUNDING = 1e-9  # 1; error of a quotient or a share
BELOW_ONE = 1e-15  # 1; a probability is at least so far below one
GAUGE_SQUARED = 1e-10  # 1; shorter directions that absorb freely, over the longest, are gauges
LEAST_RELATIVE, MOST_RELATIVE = 1e-8, 1e6  # 1; limits of a shared column's variance over one rest's
NEGLIGIBLE = 1e-9  # 1; of an effect's largest term
WEAKEST = 1e-7  # 1; weaker directions contain no information
DEPENDENT_SHARE = 1e-6  # 1; a feature with less of its own depends on the others
RANK_SHARE = 1e-9  # 1; smaller singular values count as zero
ORDER_DIGITS = 3  # decimals by which comparisons are sorted
MOVE_DIGITS = 12  # decimals of moves that are compared
UM_DIGITS = 3  # digits of micrometres in text for a person
GAIN_BEGINS, GAIN_TAKES, HELD_OUT_BEGINS = 0.9, 0.1, 0.95  # 1; shares of the progress shown
LEAST_GAIN_SHARE = 1e-6  # 1; a smaller change of the error is rounding, not gain
INTERVAL_TAIL = 0.025  # 1; below and above an interval of 95 %
LEAST_P = 1e-300  # 1; the least p value reported: smaller ones underflow
