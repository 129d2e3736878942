"""The catalogue finds what is in its packages, and each cause says all of itself."""

from dataclasses import replace
from pathlib import Path

from armd.compensation.effects import catalogue, encoder, unknown
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.older import OLDER
from support.whole_scene import whole_scene


def test_every_file_of_the_packages_is_in_the_catalogue() -> None:
    """Named as its file, but for the artefact's, which has two."""
    files = {
        path.stem
        for package in catalogue.PACKAGES
        for folder in package.__path__
        for path in Path(folder).glob("*.py")
        if path.stem != "__init__"
    }
    assert len(files) > 20
    expected = files - {"artefact"} | {"artefact_expansion", "artefact_length", "unknown"}
    assert set(CATALOGUE) == expected
    assert list(CATALOGUE)[-1] == "unknown" == unknown.EFFECT.cause


def test_a_new_file_is_a_cause(tmp_path, monkeypatch) -> None:
    """Nothing but the file itself is touched."""
    text = Path(next(iter(encoder.__path__)), "encoder_scale.py").read_text()
    (tmp_path / "toy_cause.py").write_text(text.replace('"encoder_scale"', '"toy_cause"'))
    monkeypatch.setattr(encoder, "__path__", [*encoder.__path__, str(tmp_path)])
    found = {effect.cause: effect for effect in catalogue._load_effects()}
    assert set(found) - set(CATALOGUE) == {"toy_cause"}


def test_each_cause_is_told_to_a_person_in_full() -> None:
    for cause, effect in CATALOGUE.items():
        assert effect.cause == cause
        for text in (effect.reason, effect.confounded_with, effect.experiment):
            assert text and text[-1] != ".", cause  # they are parts of sentences
        if effect.by_motion:
            assert "time" in effect.needs or "rates" in effect.needs, cause


def test_what_goes_by_temperature_may_be_older_with_a_name_or_without() -> None:
    """Else what has no name grew likelier by the share that the named ones give to being older."""
    facts = whole_scene().free
    warm = dict.fromkeys(facts.sensors, (22.0, 26.0, 30.0))
    assert not any(map(_is_older, catalogue.list_all_candidates(facts)))
    by_age: dict[bool, set[tuple[str, str, str]]] = {True: set(), False: set()}
    for candidate in catalogue.list_all_candidates(replace(facts, calibrated_c=warm)):
        if candidate.cause in ("joint_thermal", "unknown") and "theta" in candidate.columns[0].name:
            name = candidate.columns[0].name.removesuffix(f", {OLDER}")
            by_age[_is_older(candidate)].add((*candidate.place, name))
    orders = {f"theta_2 × ΔT(t2)^{n}" for n in (1, 2)}
    assert {name for *_, name in by_age[True]} >= {"theta", *orders}
    assert by_age[True] < by_age[False]


def _is_older(candidate: Candidate) -> bool:
    return candidate.columns[0].name.endswith(OLDER)
