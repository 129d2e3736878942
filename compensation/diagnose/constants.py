"""Every constant of the diagnosis: name, value, unit, why.

First those that decide what is found, how probable it is and whether it is written; then what is
only drawn and worded, what bounds the work, and what keeps the arithmetic defined. `1` is a ratio
or a probability, `σ` a number of standard uncertainties, `nat` natural logarithms of a probability.
What a cause can do to an arm stands with it in `effects/`. What halving and doubling each of the
first does to frozen cases: docs/developer/constants.csv.
"""

from __future__ import annotations

import math

# --- What decides -------------------------------------------------------------------------------

# What is significant, and what has a name
ALPHA = 0.01  # 1; family-wise false-alarm rate on clean data
CLEARLY = 10.0  # 1; another name is clearly likelier so many times as probable (Jeffreys: strong)
AS_WELL = 10.0  # nat; what is less likely by up to so much still explains as well
UNKNOWN_PRIOR = 0.05  # 1; prior share of what the catalogue does not know
EXPECTED_PRIOR = 0.5  # 1; what no calibration could know, and every arm may have: as likely as not
SHAPE_PRIOR = 0.5  # 1; that a strong finding's shape is off: as likely as not
#: 1; a cause that accounts for less of what goes with its variables is a guess. A disc whose shape
#: is off by 30 % accounts for 0.92, by half for 0.8.
ENOUGH = 0.8
LEAST_PART_SHOWN = 0.005  # 1; a part in which less of the cause shows says nothing of its size
LEAST_PROBABILITY = 0.01  # 1; an alternative, or a set of causes, less probable is not told
MOST_RIVAL_SET = 0.5  # 1; a set that has not replaced the one there is is at most as probable
ABSORBED = 1e-6  # 1; a candidate that keeps less of its squared norm in projection is absorbed
LEAST_EXPLAINED_SHARE = 0.25  # 1; who explains so much of what another does may be meant by it
#: columns; χ² of more counts mostly noise: a walk's many small steps go one way or none. There the
#: Bayes factor tells, too: it is over B once in B cases at most by chance (Markov).
MOST_COUNTED = 12
MOST_FREE_COLUMNS = 6  # columns; of more the amplitudes share one likely size
MOST_LEVERAGE = 0.9  # 1; a rest that decides so much of an amplitude has no residual to judge by
MOST_GAINED = 2.0  # 1; own tails hardly gain more than so many times what was clipped
#: nat; from about nine noise units on the likeliest kinds are compared with the tails clipped about
#: each one's own fit, and causes are tried with another shape.
STRONG = -40.0
MOST_FINDINGS = 10  # causes; more wrongs are no diagnosis
MOST_IN_PLACE = 3  # causes; one stands for two or three
CONTRADICTED = 1.0  # σ; a likelier set counts unless readings held out contradict it by so much
BEYOND_CHANCE = 1.0  # σ; a walk in time, or causes that say why: held out decides from here on

# What a cause's shape and size may be
SHAPE_OFF = 0.15  # 1; standard deviation of each harmonic's share, RMS over the turn
SHAPE_ORDERS = (1, 2)  # 1/turn; the harmonics of a shape that is off
CURVE_SCALE = 3.0  # 1; a curve's likely size, of the catalogue's, before the data have it
CURVE_SCALES = (0.3, 100.0)  # 1; how far the data may take it (empirical Bayes)
LEAST_UNEVEN = 0.5  # noise units over all readings; what shows less is left out
#: 1; growth that makes less, of what is left, does not stand out: of a disc far off its axis 22 µm
#: were left, growth would have made 22, and what there was of it, 13, was not worth a term.
STANDS_OUT = 2.0
MOST_SIGMAS = 3.0  # σ of its broadest prior; an amplitude so far from zero is none of that cause
#: σ; by less more than before a length misses by chance: of a dozen one is near its limit
CLEARLY_MORE = 1.0
OF_THEIR_OWN = 0.05  # 1; a finding of which the model's terms leave less (length) is their change
LEAST_TAKEN_UP = 1.0  # noise units; a direction that, gone as far as plausible, shows less
GAUGE = {"mm": 1.0, "rad": 2e-3}  # mm, rad; how well constants left open count as known
PER_KELVIN = 0.1  # 1/K; of that, for the slope of a term

# What is noise
GROSS = 4.0  # 1; mean over middle squared residual: gross errors (Student's t of 3 makes 2 to 3)
KNOT_S = 450.0  # s; slow drift is a random walk between knots so far apart
USUAL_DRIFT = 0.3  # 1; the drift to begin with, of the noise
FAR_LIKELIER = 10.0  # −2 log likelihood; another start is taken where it is likelier by so much
CORRELATION_SIGMAS = 5.0  # σ; a correlation is beyond doubt: one in a million independent sets
MOST_CORRELATION = 0.9  # 1; more is no noise but something that drifts
LEAST_CORRELATION = 0.01  # 1; less has no weight
LONGEST_GAPS = 3.0  # usual gaps; rests further apart tell nothing of a correlation
#: 1; a search leaves no more to the noise than another up to so many times its noise. False causes
#: made it smaller by 8 %, lost ones larger by a factor of 5.8.
AS_QUIET_AGAIN = 1.25
AS_QUIET_GROWN = 1.02  # 1; noise larger by no more is the same, of links' growth

# What belongs together, and what was touched
REST_RAD = 1e-4  # rad; readings closer in every joint, in sequence at one target, are one rest
PAUSE = 10.0  # usual gaps; between readings so far apart nobody measured
LEAST_SPAN_K = 0.05  # K; a temperature that varies by less did not vary
MOST_TELL = 0.5  # 1; a column that more of the readings have is there
POSE_TARGETS = 3  # targets; so many fix a pose and tell nothing of each other
LEAST_RESTS_BESIDE = 4  # rests; before and after tell where an artefact stood
LEAST_TARGETS = 2  # targets among them: of one nobody can tell whether it or the arm moved
MOST_TOUCHED = 6  # touches; more is not somebody touching the artefact now and then
AS_FAR_OFF = 3.0  # 1; the middle reading of a session explained is no further off, of the others'

# What readings held out decide
IN_ONE = 0.75  # 1; what shows so much in placements left out together, others cannot teach
MOST_SQUARES = 15.0  # usual squared residuals; what a gross error counts at most: six noise units
MOST_WORSE = 0.02  # 1; gross errors move the error over all by less: beyond it a finding harms
CHANGED_PRIOR = 0.05  # 1; that an arm was no longer the same when the others were taken

# --- What is drawn and worded: changes no finding, no probability, nothing written --------------

SURE = 0.95  # 1; a finding less probable is worth an experiment of its own
LEAST_WORTH_EXCLUDING = 1e-4  # 1; many less probable ones together can keep a finding in doubt
INDISTINGUISHABLE_P = 0.01  # 1; an alternative that would leave nothing significant to add
STEP_P = 1e-3  # 1; chance that noise makes any step of a target
LEAST_PART = 3  # rests; whose mean says where a target stood
BEYOND_NOISE = 1.5  # 1; residuals so many times the noise's RMS are more than noise
HALF_WIDTH = 1.96  # standard deviations; the pointwise band that holds 95 % of all data sets
BEYOND = 0.05  # 1; the share outside it
BEYOND_FLAT = 10.0  # 2 Δ ln L; what varies must explain so much more than what is flat
SHARE_BEYOND = 0.1  # 1; and this share of it
BEYOND_VALUES = 10.0  # 2 Δ ln L; a name must explain so much more than a value
SHARE_OF_NAMES = 0.05  # 1; and this share
LEAST_VARIANCE_SHARE = 1e-5  # 1; a direction of which absorbing leaves less is absorbed
#: sessions; fewer do not tell how sessions scatter, and placements are asked
LEAST_SCATTERED = 3
SIZE_SIGMAS = 2.0  # σ; a size is known
UNTOLD = 1e3  # 1; an uncertainty so many times the value: the readings do not tell it
WOULD_SHOW = 5.0  # noise units; from which on a cause is found mostly
LEAST_SPARE = 30  # numbers; fewer to spare tell no noise
FAR_TIMES = 100.0  # 1; readings so many times farther off than the middle one are no tail
MOST_TOLD = 3  # rows; of those are listed
MOST_PARTS = 40  # sessions, placements, targets; a longer list is no help

# --- What bounds the work: grids, rounds, draws, groups -------------------------------------------

# The search
MOST_SEARCH_STEPS = 16  # steps; ten findings, and some renamed or refused
MOST_RENAMINGS = 3  # times; a name that changes thrice is a circle
MOST_FIRST = 6  # causes tried first in the place of what follows anything in time
MOST_RIVALS = 8  # alternatives told, and weighed with their own shapes
MOST_COMPARED = 20  # alternatives compared
MOST_EXPLAINING = 6  # causes that may explain a session which does not fit the others
MOST_REFINED = 5  # places whose grids are refined before they are compared
MOST_RICHER = 3  # general bases made richer: one that always competes swallows several causes
MOST_AT_ONCE = 64  # values weighed at once; of more, some first
MOST_ALIKE = 12  # kinds compared with their own tails
MOST_BENT = 8  # causes tried with another shape
MOST_REPEATED = 2  # searches without what was refuted
MOST_GROWTH_ROUNDS = 10  # rounds over all links; three settle
RANGE_PARTS = 8  # parts of equally many rests of a variable's range, and of the time
STEP_WORK = 1.0  # looks at the whole catalogue of a step of the search, which also fits and prunes
TRIAL_WORK = 0.3  # the same of a set tried instead of another
REPEATED_WORK = 0.4  # the same of a step of the search repeated
MOST_PRODUCTS = 40e6  # products of candidates' and shared columns: about 1e6 are a second
MANY_READINGS = 2000  # readings; of fewer the bound is higher: a look costs less
MOST_TIMES = 4.0  # 1; by so much at most
MOST_OF_SETS = 0.4  # 1; other sets may take this share of the work
LEAST_REPEATED = 0.3  # 1; so much is kept for the search repeated
ROWS_A_COLUMN = 60.0  # rows that count as one shared column in the work of scoring
MOST_INSTANTS = 40  # moments at which something may have stepped: the first, coarse grid
MOST_SPELLS = 8  # spells between pauses
TOUCHED_GRID = 12  # instants in a placement on the first, coarse grid
TOUCHED_FINER = 100  # parts of a placement tried at once
REWEIGHTINGS = 8  # rounds of reweighting, of a pose and of a candidate
LEAST_GAINED = 0.01  # nat; a round that gains less was the last

# The fit
CURVED_SHARE = 0.1  # 1; of the noise: a step that errs by more is linearised anew
CURVED_LENGTH_MM = 200.0  # mm; a step errs by about its square over this
MOST_FIT_STEPS = 6  # steps
SIZING_STEPS = 6  # steps that find a curve's size
MOST_CLIPPINGS = 10  # first estimates of the noise, gross errors clipped
NOISE_SETTLED = 0.9  # 1; until it falls by less than a tenth
SHARED_ALIKE = 0.05  # 1; nor does what copies of a posture share change by more
STAYS = 0.1  # σ; a solution that changes by less stays
MOST_FOLLOW_ROUNDS = 30  # rounds; three to six do, but along a valley shorter steps follow it down
MOST_TURNS = 5  # turns; two do, and what does not settle stays as it is
COLUMNS_CHANGED = 0.01  # 1; columns are made anew where amplitudes changed by more
TURN_SETTLED = 0.05  # log; a ratio of turns to points that changes by less has settled
TURN_RATIOS = 1e-4, 1e4  # 1; no orientation is so much better, or worse, than a point
SLOPE_STEP = 0.02  # 1; values to either side between which a signature's slope is taken
CURVE_POINTS = 360  # points over the turn: over ten to the shortest period there is
SEEN_POINTS = 3  # points to either side of an angle measured
LEFT_OUT_PARTS = 24  # parts of rests left out: about as many as a calibration has constants
WALK_RANGE = 1.6  # 1; highest to lowest of a walk, of its end's deviation (Feller 1951: √(8/π))
MOST_FUNCTIONS = 40  # of a walk: so many leave 1/(π² m) of its variance; sessions need several
WALK_MOMENTS = 160  # moments at which the walk's covariance is taken
CORRELATIONS_TRIED = (0.3, 0.5, 0.65, 0.8)  # 1; up to the most; between them along a line
MOST_MEMORY_RESTS = 400  # rests of a placement; of more too little is absorbed to hide a memory

# The noise
MOST_KNOTS = 8  # knots of the drift in a session
LEAST_DRIFT_ROWS = 6  # readings; fewer tell no drift
MOST_ROBUST = 12  # fits with gross errors clipped
MOST_DRIFT = 1e3  # 1; beyond it products of columns hold nothing of the noise any more
NOISE_SCALES = (1.0, 0.1, 0.01, 0.001)  # 1; starts
NOISE_DRIFTS = (0.03, 0.3, 3.0, 30.0, 300.0)  # 1; starts, of the noise
SCALE_STEPS = (0.1, 0.5)  # log; first steps of scale and drift
SCALE_SETTLED = 0.02  # log; when they have settled
MOST_EVALUATIONS = 400  # most settle within 40
SAME_SCALE = 0.05  # log; lengths are weighed by a scale so near to the one found
MOST_SCALES = 6  # tries at that
LEAST_ENCODER_SHARE = 0.01  # 1; of the noise from encoders, where it is looked for
MOST_ENCODER_SHARE = 0.99  # 1
NEAR_SHARE = 0.15  # 1; about the share found before
SHARE_SETTLED = 0.03  # 1
FIRST_SHARE_STEPS = 7  # evaluations
NEXT_SHARE_STEPS = 3  # evaluations, where one was found before
LEVER_MM = 500.0  # mm; from a joint to the tip, roughly: there a scatter in mm is an angle

# Readings held out, drawn and resampled
MOST_FOLDS = 4  # parts of placements left out in turn
BLOCKS = 5  # parts of readings, where there is one placement only
TARGET_FOLDS = 4  # parts of targets
TIME_PARTS = 4  # parts of the time
KNOWN_PARTS = (2, 3)  # parts; what follows them is predicted from what is before
TRUTH_BLOCKS = 40  # blocks of readings with truth of their own: they share their time only
RESAMPLES = 1000  # sets
WIDEST_DEG = 10.0  # °; no bin of an angle is wider
MOST_BINS = 36  # bins of equal count
LEAST_BIN_RESTS = 8  # rests in each
LEAST_BINS = 2  # bins; nothing is told by fewer
WAVES = 20  # a turn, at most: a wheel's few teeth, a bearing's rollers
INSEPARABLE = 0.9  # 1; squared correlation of variables that readings do not tell apart
SHORTEST_MM = 20.0  # mm; a shorter link has no component of its own
CURVES = 50_000  # curves for a small p-value: the least of 700 must be below 0.05 / 700
CURVES_AT_ONCE = 500  # curves: what a cache holds
ENOUGH_CURVES = 100  # with as much outside: they tell a p-value to a tenth of itself
CURVES_SEED = 0xC0E  # of their random numbers
MOST_TOGETHER = 120  # sums whose covariance is known as a whole; more count as independent
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
EVENLY = 1.0 / math.sqrt(12.0)  # 1; standard deviation of what is spread evenly over one
RIGHT_ANGLE_DEG = 90.0  # °; between a signature and nothing
LEAST_POSITIVE = 1e-300  # stands for nothing where something is divided by it
LEAST_SQUARE = 1e-12  # the same of sums of squares
LEAST_SUM = 1e-30  # the same of variances of sums
LEAST_VARIANCE_MM2 = 1e-14  # mm²; a variance that is inverted
TINY_MM2 = 1e-18  # mm²; the same of what is compared
LEAST_MM = 1e-6  # mm; no reading is better than a nanometre, even where everything is absorbed
LEAST_SIZE_MM = 1e-3  # mm; a size that others are measured in
LEAST_APART_S = 1e-3  # s; between readings, for a speed
ROUNDING = 1e-9  # what a quotient or a share errs by
BELOW_ONE = 1e-15  # 1; a probability is no nearer to one
GAUGE_SQUARED = 1e-10  # 1; a direction that absorbs freely, so short beside the longest: a gauge
LEAST_RELATIVE, MOST_RELATIVE = 1e-8, 1e6  # 1; variance of a shared column over one rest's
NEGLIGIBLE = 1e-9  # 1; of an effect's largest term
WEAKEST = 1e-7  # 1; weaker directions hold nothing
DEPENDENT_SHARE = 1e-6  # 1; a feature with less of its own is made of the others
RANK_SHARE = 1e-9  # 1; singular values below it count as none
ORDER_DIGITS = 3  # decimals by which comparisons are sorted
MOVE_DIGITS = 12  # decimals of moves that are compared
UM_DIGITS = 3  # digits of micrometres as a person reads them
GAIN_BEGINS, GAIN_TAKES, HELD_OUT_BEGINS = 0.9, 0.1, 0.95  # 1; of the progress shown
LEAST_GAIN_SHARE = 1e-6  # 1; less of the error is rounding, no gain
INTERVAL_TAIL = 0.025  # 1; below and above an interval of 95 %
LEAST_P = 1e-300  # 1; the least p value told: less is what the arithmetic cannot hold
