"""The catalogue finds what stands in its rooms, and each cause says all of itself."""

from pathlib import Path

from armd.compensation.effects import catalogue, encoder, unknown
from armd.compensation.effects.catalogue import CATALOGUE


def test_every_file_of_the_rooms_is_in_the_catalogue() -> None:
    """Named as its file, but for the artefact's, which has two."""
    files = {
        path.stem
        for room in catalogue.ROOMS
        for folder in room.__path__
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
    found = {effect.cause: effect for effect in catalogue._found()}
    assert set(found) - set(CATALOGUE) == {"toy_cause"}


def test_each_cause_is_told_to_a_person_in_full() -> None:
    for cause, effect in CATALOGUE.items():
        assert effect.cause == cause
        for text in (effect.reason, effect.confounded_with, effect.experiment):
            assert text and text[-1] != ".", cause  # they are parts of sentences
        if effect.by_motion:
            assert "time" in effect.needs or "rates" in effect.needs, cause
