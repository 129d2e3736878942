"""Calibration files: read once, hashed as they stand, and refused in words whatever is wrong."""

from __future__ import annotations

import hashlib
import json
import math
import time
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from armd.compensation.effects.effect import SessionFacts
from armd.compensation.effects.setup.mount_drift import make_steady_drift
from armd.compensation.model import calibration as module
from armd.compensation.model.arm import load_arm
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.calibration import (
    MOST_TERMS,
    Calibration,
    hash_content,
    load_calibration,
    save_calibration,
)
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.slow_factors import Time
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term
from armd.errors import BadInput
from support.drawn import drawn
from support.drawn_calibration import an_arm
from support.spoilt_files import fifo, loop, nest

DATA = Path(__file__).parent / "data"
RELEASED = sorted(DATA.glob("calibration-*.json"))  # one per released version, as it wrote them


def plain(**changes) -> Calibration:
    constants = dict.fromkeys(ParameterLayout(3).names, 0.0)
    return drawn(an_arm(3), **{"constants": constants} | changes)


def rewritten(path: Path, change, rehash: bool = True) -> None:
    """The file with its content changed by *change*, and the hash of what it says then."""
    content = json.loads(path.read_text())
    change(content)
    if rehash:
        content["content_sha256"] = hash_content(content)
    path.write_text(json.dumps(content))


@pytest.mark.parametrize("path", RELEASED, ids=lambda path: path.stem)
def test_files_of_every_released_version_are_read(path: Path) -> None:
    loaded = load_calibration(path)
    assert loaded.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert len(loaded.content.terms) == 15
    assert loaded.data == path.read_bytes()


def test_a_field_added_to_the_schema_refuses_no_file_that_lacks_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Later(Calibration):
        operator: str = "nobody"

    monkeypatch.setattr(module, "Calibration", Later)
    for path in RELEASED:
        assert load_calibration(path).content.operator == "nobody"
    # And a file that leaves out what has a default is hashed as it stands.
    path = tmp_path / "calibration.json"
    save_calibration(path, plain())
    rewritten(path, lambda content: content.pop("artefact"))
    assert load_calibration(path).content.artefact is None


def test_what_is_loaded_is_what_was_hashed_though_the_file_is_replaced_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, other = tmp_path / "calibration.json", tmp_path / "other.json"
    first = save_calibration(path, plain())
    save_calibration(other, plain(provenance={"n": 2}))
    parse = module._parse

    def replace_then_parse(*arguments):
        other.replace(path)
        return parse(*arguments)

    monkeypatch.setattr(module, "_parse", replace_then_parse)
    loaded = load_calibration(path)
    assert (loaded.sha256, loaded.content.provenance) == (first.sha256, {})
    monkeypatch.setattr(module, "_parse", lambda *a: (path.unlink(), parse(*a))[1])
    assert load_calibration(path).content.provenance == {"n": 2}


def many_terms(path: Path) -> None:
    term = {"parameter": "a_2", "basis": [], "coefficient": 0.0}
    rewritten(path, lambda content: content.update(terms=[term] * (MOST_TERMS + 1)))


@pytest.mark.parametrize(
    ("spoil", "found"),
    [
        (nest, "the file: found brackets in brackets without end"),
        (loop, "the file: found a symbolic link that leads back to itself"),
        (fifo, r"the file: found a pipe \(FIFO\)"),
        (many_terms, f"terms: found {MOST_TERMS + 1} terms, expected {MOST_TERMS} at most"),
        (lambda path: path.write_text("[" + "1" * 5000 + "]"), "a number of thousands of digits"),
        (lambda path: path.write_text("[]"), "the file: found list, expected an object"),
        (lambda path: path.unlink(), "the file: found nothing"),
        (lambda path: path.write_bytes(b"x" * (9 << 20)), "9437184 bytes, expected 8388608"),
        (
            lambda path: rewritten(path, lambda c: c["constants"].update(a_1=1e308)),
            r"constants.a_1: found 1e\+308 mm, expected 100000 at most",
        ),
        (
            lambda path: rewritten(path, lambda c: c.update(created="yesterday")),
            "created: found 'yesterday', expected an instant",
        ),
        (
            lambda path: rewritten(path, lambda c: c.update(reference_temperature_c=20.5), False),
            "content_sha256: found a content that does not match",
        ),
        (
            lambda path: rewritten(
                path, lambda c: c["terms"].extend([{"parameter": "a_2", "basis": [], "x": 1}] * 3)
            ),
            r"terms\[151\]\.x: found an unknown key",
        ),
    ],
)
def test_whatever_is_wrong_is_told_at_once(tmp_path: Path, spoil, found: str) -> None:
    path = tmp_path / "calibration.json"
    save_calibration(path, plain(terms=[Term(parameter="a_2")] * 150))
    spoil(path)
    began_s = time.process_time()
    with pytest.raises(BadInput, match=found):
        load_calibration(path, an_arm(3))
    assert time.process_time() - began_s < 5.0  # a hang, not a speed: it takes milliseconds


def test_lengths_and_angles_no_arm_can_have_are_refused(tmp_path: Path) -> None:
    joint = "[[joint]]\na_mm = 100.0\n"
    text = f'schema = "armd.arm/1"\nserial_number = "T"\n{joint * 3}'
    path = tmp_path / "arm.toml"
    path.write_text(text)
    load_arm(path)
    for old, new, key in (
        ("a_mm = 100.0", "a_mm = 1e308", r"joint\[1\].a_mm"),
        ("a_mm = 100.0", "alpha_deg = -1e9", r"joint\[1\].alpha_deg"),
        ("a_mm = 100.0", "max_deg = 1e300", r"joint\[1\].max_deg"),
        (joint * 3, f"{joint * 3}[tip]\noffset_mm = [0.0, 0.0, 1e200]\n", "tip.offset_mm"),
    ):
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(BadInput, match=key):
            load_arm(path)


def test_a_term_that_follows_time_ends_when_its_file_was_made_unless_it_says_when(
    tmp_path: Path,
) -> None:
    made_s = 1_767_225_600.0  # plain().created
    terms = [
        Term(parameter="a_1", basis=[Time(since_unix_s=made_s - 7200)], coefficient=0.005),
        Term(parameter="a_1", basis=[Time(since_unix_s=1e9, until_unix_s=2e9)], coefficient=1.0),
        Term(parameter="a_1", basis=[Time(since_unix_s=made_s + 9.0)], coefficient=1.0),
    ]
    save_calibration(tmp_path / "calibration.json", plain(terms=terms))
    loaded = load_calibration(tmp_path / "calibration.json").content.terms
    ends = [term.basis[0].until_unix_s for term in loaded]
    assert ends == [made_s, 2e9, made_s + 9.0]

    at_s = np.array([0.0, made_s - 7200, made_s - 3600, made_s, made_s + 1e8, math.nan])
    n = len(at_s)
    nothing = np.zeros((n, 3))
    states = States(nothing, nothing, np.full((n, 2), 20.0), at_s, nothing, np.zeros(n, np.int64))
    hours = compute_basis_values(loaded[:1], states, an_arm(3), 20.0, np.zeros(24))[:, 0]
    np.testing.assert_allclose(hours, [0.0, 0.0, 1.0, 2.0, 2.0, math.nan])


def test_what_a_diagnosis_writes_of_time_says_from_when_to_when_it_was_seen() -> None:
    facts = cast(SessionFacts, SimpleNamespace(start_unix_s=1.7e9, end_unix_s=1.7e9 + 3600))
    factors = [
        factor
        for column in make_steady_drift(facts).columns
        for term in column.terms
        for factor in term.basis
    ]
    assert {(f.since_unix_s, f.until_unix_s) for f in factors} == {(1.7e9, 1.7e9 + 3600)}


def test_a_negative_variance_is_refused(tmp_path: Path) -> None:
    """Points would carry a covariance of 0."""
    path = tmp_path / "cal.json"
    save_calibration(path, plain(covariance_of=["d_1"], covariance=[[1e-6]]))
    load_calibration(path)
    rewritten(path, lambda content: content["covariance"][0].__setitem__(0, -1e-6))
    with pytest.raises(BadInput, match="variances of 0 or more, not -1e-06 of d_1"):
        load_calibration(path)


@pytest.mark.parametrize(
    ("covariance", "words"),
    [
        ([[1.0, 2.0], [2.0, 1.0]], "correlations of ±1 at most"),
        ([[1.0, 0.5], [-0.5, 1.0]], "a symmetric covariance"),
        ([[0.0, 0.1], [0.1, 1.0]], "a symmetric covariance"),
        ([[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]], "positive semidefinite"),
    ],
)
def test_a_covariance_that_is_none_is_refused(
    tmp_path: Path, covariance: list[list[float]], words: str
) -> None:
    """Some point would have a variance below 0. Whatever the units: here of 1e-6 and 1e-3."""
    path, n = tmp_path / "cal.json", len(covariance)
    scale = [1e-6, 1e-3, 1.0][:n]
    names = ["theta_1", "d_1", "a_1"][:n]
    one = [[float(i == j) * scale[i] ** 2 for j in range(n)] for i in range(n)]
    save_calibration(path, plain(covariance_of=names, covariance=one))
    load_calibration(path)
    scaled = [[covariance[i][j] * scale[i] * scale[j] for j in range(n)] for i in range(n)]
    rewritten(path, lambda content: content.__setitem__("covariance", scaled))
    with pytest.raises(BadInput, match=words):
        load_calibration(path)


@pytest.mark.parametrize("size", [-1e-6, 1e308], ids=["negative", "beyond-squaring"])
@pytest.mark.parametrize("key", ["encoder_rad", "reading_mm", "temperature_c"])
def test_impossible_noise_is_refused_by_its_key(tmp_path: Path, key: str, size: float) -> None:
    path = tmp_path / "cal.json"
    save_calibration(path, plain())
    wrong = [1e-6, size] if key == "encoder_rad" else size
    rewritten(path, lambda content: content.setdefault("noise", {}).__setitem__(key, wrong))
    with pytest.raises(BadInput, match=rf"noise\.{key}"):
        load_calibration(path)
