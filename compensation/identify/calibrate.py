"""Calibrate an arm from sessions: geometry, thermal model, noise, uncertainty, and residuals."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from armd import __version__
from armd.compensation.data.sessions.session import Session
from armd.compensation.data.soundness.soundness import fit_to_identify
from armd.compensation.estimate.folds import make_placement_folds
from armd.compensation.estimate.gauge import list_free_constants
from armd.compensation.estimate.noise.sensor import estimate_sensor_noise_c
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.estimate.orientations import add_orientation_rows, add_orientations
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.admission.find_second_group import find_second_group
from armd.compensation.identify.admission.inconsistent_session import (
    find_inconsistent_session,
    refuse_mistakes,
)
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.identify.admission.requirements import (
    choose_readings,
    describe_unknown,
    is_plausible,
    require_enough_readings,
    require_more_than_placing,
    require_plausible,
    require_useful_readings,
)
from armd.compensation.identify.admission.touched_surfaces import require_surfaces
from armd.compensation.identify.admission.wrong_names import refuse_misnamed, report_misnamed
from armd.compensation.identify.certificate import Misses, Suspects, judge
from armd.compensation.identify.drawing import compute_nominal_rms_um, find_off_nominal
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification, fit
from armd.compensation.identify.fit import compute_rms_um as residual_rms_um
from armd.compensation.identify.heldout import HeldOut
from armd.compensation.identify.next_step import CalibratedFiles
from armd.compensation.identify.orientation import compute_orientation_gain
from armd.compensation.identify.reflectors import (
    ReflectorTerms,
    locate_reflectors,
    make_reflector_terms,
    require_one_kind,
    require_polynomial,
)
from armd.compensation.identify.result import Result
from armd.compensation.identify.thermal.comparison import Comparison, Trial
from armd.compensation.identify.thermal.temperatures import are_far_apart
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, Noise, name_constants
from armd.compensation.model.terms import Term
from armd.compensation.progress import TellStep
from armd.errors import ArmdError
from armd.terminal.counted import format_count

ThermalMethod = Literal["polynomial", "zones", "components", "per-temperature"]


@dataclass(frozen=True)
class Options:
    """The options of a calibration; with the defaults, the data decide."""

    thermal_order: int | None = None  # None: chosen by the held-out error
    compare: bool = True  # thermal models; if not, the linear one is used where it is determined
    thermal_method: ThermalMethod = "polynomial"
    offset: bool = False  # C of eq. 14, per temperature; other models have it in the constants
    command: str = ""  # for the provenance
    arm_file: str = "arm.toml"  # as a user types it


def calibrate(
    sessions: Sequence[Session],
    arm: Arm,
    options: Options = Options(),
    progress: TellStep | None = None,
) -> Result:
    """Identify geometry and, where the temperatures allow it, the thermal model.

    Raises `BadInput` where the sessions cannot give what is asked for.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        return _calibrate(sessions, arm, options, progress)


def _calibrate(
    sessions: Sequence[Session], arm: Arm, options: Options, progress: TellStep | None
) -> Result:
    files = ", ".join(str(session.path) for session in sessions)
    sound = fit_to_identify(sessions, arm)
    sessions, arm, notes = sound.sessions, sound.arm, list(sound.remarks)
    unknown = list_free_constants(arm)
    observations, groups = choose_readings(
        collect_observations(sessions, arm), files, options.thermal_order, notes
    )
    tips = make_reflector_terms(observations, arm.nominal()[arm.layout.tip])
    require_one_kind(tips, files)
    observations = tips.observations
    unknown = tips.identified(unknown)
    if tips.hides_tip:
        notes.append("no reading touches with the tip itself: it is that of arm.toml")
    drawn = evaluate_model(observations, arm.nominal(), tips.terms, arm.reference_temperature_c)
    require_surfaces(sessions, drawn.observations, drawn.poses, drawn.position_mm)
    require_more_than_placing(observations, files)
    all_observations = add_orientations(observations)
    simple = not tips.terms and all_observations.n == observations.n
    if simple:  # else the tip of each reading is not known
        refuse_mistakes(sessions, observations)
    thermal = len(groups) > 1 and options.thermal_order != 0
    if thermal and not simple:
        require_polynomial(options.thermal_method, files)
    terms = make_length_terms(arm, [1]) if thermal else []
    first_whole = final_whole = _fit(all_observations, tips, unknown, terms, progress)
    first = first_whole.of_points()
    require_surfaces(
        sessions, observations, first.linearisation.poses, first.linearisation.position_mm
    )
    nominal_rms_um = compute_nominal_rms_um(observations, tips.terms, tips.free)
    inconsistent = find_inconsistent_session(sessions, first, nominal_rms_um) if simple else None
    second = (
        None
        if not simple or (inconsistent and inconsistent.tip)
        else find_second_group(sessions, first)
    )
    if second:
        inconsistent = None  # it also explains that session's rows
        if not is_plausible(first):
            raise second.refusal()
    if inconsistent:
        notes.append(inconsistent.in_words())
    # A fit to many misnamed readings may be so wrong that the nominal model finds them better.
    if not is_plausible(first) and simple:
        refuse_misnamed(sessions, observations, AssumedModel.from_identification(first))
        refuse_misnamed(sessions, observations, AssumedModel.from_calibration(arm, None))
    if not second:  # else the second group is what moves the links
        require_plausible(first, str(inconsistent.path) if inconsistent else files)
    notes += report_misnamed(sessions, observations, AssumedModel.from_identification(first))
    trials: list[Trial] = []
    order, final = 0, first
    per_temperature = thermal and options.thermal_method == "per-temperature"
    if thermal and not simple:
        order = options.thermal_order or int(are_far_apart(groups))
        terms = make_length_terms(arm, range(1, order + 1))
        final_whole = _fit(all_observations, tips, unknown, terms, progress, first_whole)
        final = final_whole.of_points()
        notes.append(f"no thermal models are compared here: order {order}")
    elif thermal and not options.compare:
        order = 1 if are_far_apart(groups) or Comparison(first, groups).shows_expansion() else 0
        terms = terms if order else []
        final = _fit(observations, tips, unknown, terms, progress, first)
    elif thermal:
        comparison = Comparison(first, groups)
        trials = comparison.trials()
        if per_temperature:
            for _, group in groups:
                require_enough_readings(observations.rows(group), unknown, files)
            order, final, heldout = comparison.regressed(
                trials, options.thermal_order, options.offset
            )
        else:
            order, terms = _choose_terms(comparison, trials, arm, options, notes)
            final = _fit(observations, tips, unknown, terms, progress, first)
    if not final.converged:
        notes.append(f"the fit did not settle within {final.steps} steps")
    if final.region.any() and not second:
        notes.append(
            f"{format_count(int(final.region.sum()), 'reading')} far off like others near in"
            " posture: no outliers, they count fully; `armd diagnose` looks for why"
        )
    by = "temperature"
    if not per_temperature:
        base = final if simple else final_whole
        folds, by = make_placement_folds(observations)
        if not simple:  # an orientation is held out together with its reading
            folds = [add_orientation_rows(observations, fold) for fold in folds]
        columns = base.unknowns.columns(
            base.linearisation.jacobian, base.linearisation.basis, base.terms
        )
        scale = base.solution.scale
        left_out = HeldOut(
            base, columns, scale, base.linearisation.residual_mm, -base.departure, folds
        )
        heldout = left_out.errors(np.arange(len(scale)))
    terms, reference_c = final.terms, final.reference_c
    evaluation = evaluate_model(observations, final.constants, terms, reference_c)
    rms_um = residual_rms_um(evaluation.residual_mm)
    lengths = evaluation.lengths
    # Copies of one reading fit any geometry: where the nominal model misses by nothing, nothing
    # helps.
    share = heldout.rms_um / nominal_rms_um if nominal_rms_um else 1.0
    require_useful_readings(first, share, files, notes)
    gain = compute_orientation_gain(final_whole)
    if gain:
        notes.append(gain.in_words())
    far_entries = find_off_nominal(first)
    notes += [entry.in_words() for entry in far_entries]
    noise_rms_um = 1e3 * final.noise.distance_mm(final.linearisation.joints, observations.freedom)
    certificate = judge(
        first,
        first.converged and final.converged,
        Misses(nominal_rms_um, noise_rms_um, heldout, by),
        lengths,
        Suspects(inconsistent.path if inconsistent else None, second, far_entries),
        CalibratedFiles(tuple(session.path for session in sessions), options.arm_file),
    )
    provenance = {
        "command": options.command,
        "version": __version__,
        "sessions": [
            {"name": s.name, "started_unix_s": s.started_unix_s, "sha256": s.fingerprint()}
            for s in sessions
        ],
        "readings": observations.n,
        "rms_um": rms_um,
        "heldout_rms_um": heldout.rms_um,
        "heldout_without_outliers_um": heldout.without_down_weighted_um,
        "heldout_by": by,
        "thermal_order": order,
        "certificate": asdict(certificate),
        "lengths": [length.as_json() for length in lengths],
        "off_drawing": [entry.as_json() for entry in far_entries],
        "odd_session": inconsistent.in_words() if inconsistent else None,
        "thermal_method": options.thermal_method if order else "none",
        "thermal_offset": ("identified" if options.offset else "0")
        if per_temperature
        else "in the constants",
    }
    return Result(
        calibration=as_calibration(final.without_terms(len(tips.terms)), provenance),
        fit=final,
        rms_um=rms_um,
        heldout=heldout,
        heldout_by=by,
        thermal_order=order,
        thermal_method=options.thermal_method if order else "none",
        trials=trials,
        unidentifiable=describe_unknown(final),
        certificate=certificate,
        lengths=lengths,
        inconsistent_session=inconsistent,
        off_drawing=far_entries,
        notes=notes,
        second_group=second,
        orientation=gain,
        reflectors=locate_reflectors(
            observations, final.constants, final.terms, final.unknowns.names, final.covariance
        ),
    )


def as_calibration(identification: Identification, provenance: dict[str, Any]) -> Calibration:
    """Return a fit as the calibration that the daemon runs."""
    arm, states = identification.observations.arm, identification.observations.states
    ranges = {}
    for name, column in zip(arm.sensors, states.temperature_c.T, strict=True):
        if name in arm.used_sensors and np.isfinite(column).any():
            ranges[name] = (float(np.nanmin(column)), float(np.nanmax(column)))
    return Calibration(
        arm=arm.serial_number,
        created=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        reference_temperature_c=identification.reference_c,
        temperature_range_c=ranges,
        constants=name_constants(identification.constants, arm.n_joints),
        terms=identification.terms,
        covariance_of=identification.unknowns.names,
        covariance=identification.covariance.tolist(),
        noise=Noise(
            encoder_rad=[identification.noise.encoder_rad] * arm.n_joints,
            reading_mm=identification.noise.reading_mm,
            temperature_c=estimate_sensor_noise_c(
                states, [arm.sensors.index(name) for name in ranges]
            ),
        ),
        provenance=provenance,
    )


def _fit(
    observations: Observations,
    tips: ReflectorTerms,
    unknown: Sequence[str],
    terms: Sequence[Term],
    progress: TellStep | None,
    start: Identification | None = None,
) -> Identification:
    """Fit *unknown* constants, the free terms of reflectors, and *terms*."""
    arm, n_tip_terms = observations.arm, len(tips.terms)
    unknowns = Unknowns(unknown, [*tips.free, *range(n_tip_terms, n_tip_terms + len(terms))])
    tip_terms = tips.terms if start is None else start.terms[:n_tip_terms]
    return fit(
        observations,
        arm.nominal(),
        [*tip_terms, *terms],
        unknowns,
        arm.reference_temperature_c,
        noise=start.noise if start else None,
        begin=start.constants if start else None,
        progress=progress,
    )


def _choose_terms(
    comparison: Comparison,
    trials: Sequence[Trial],
    arm: Arm,
    options: Options,
    notes: list[str],
) -> tuple[int, list[Term]]:
    """Choose thermal order and terms: as the options state, otherwise by the held-out error.

    Raises `ArmdError` if a stated model needs more temperatures.
    """
    if options.thermal_method != "polynomial":
        name = {"zones": "two zones", "components": "principal components"}[options.thermal_method]
        if name not in comparison.models:
            count = format_count(len(comparison.groups), "temperature")
            raise ArmdError(f"{name}: {count}, expected at least 3")
        return 1, comparison.models[name]
    if options.thermal_order is not None:
        terms = make_length_terms(arm, range(1, options.thermal_order + 1))
        return options.thermal_order, [*terms, *comparison.growth]
    order = comparison.best_order(trials)
    if order == 0:
        notes.append("no thermal order lowers the error on readings left out")
        return 0, []
    terms = [*make_length_terms(arm, range(1, order + 1)), *comparison.growth]
    for extension in comparison.extended(terms):
        notes.append(f"{extension.name}: {extension.heldout_rms_um:.2f} µm held out, taken")
        terms = extension.terms
    return order, terms
