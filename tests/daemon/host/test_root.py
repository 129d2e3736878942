"""A service as root is refused; by hand, or deep under some service, it runs and is warned of."""

from __future__ import annotations

import os

import pytest

from armd.daemon import cli


@pytest.fixture
def root(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setenv("SYSTEMD_EXEC_PID", str(os.getpid()))
    return monkeypatch


def first_error(capsys: pytest.CaptureFixture[str], *options: str) -> str:
    """What stops `armd run` of a configuration that does not exist."""
    assert cli.main(["run", *options, "/no/armd.toml"]) == 2
    return capsys.readouterr().err


def test_a_service_as_root_is_refused(root, capsys) -> None:
    assert first_error(capsys) == (
        "armd: systemd unit: User: found root, expected a user of its own (User=armd), "
        "or armd run --allow-root\n"
    )


def test_it_runs_if_allowed_or_as_somebody_or_from_a_shell_under_a_service(root, capsys) -> None:
    """The last as on a runner of continuous integration: the variables are inherited."""
    assert "no/armd.toml" in first_error(capsys, "--allow-root")
    with root.context() as somebody:
        somebody.setattr(os, "geteuid", lambda: 1000)
        assert "no/armd.toml" in first_error(capsys)
    root.setenv("SYSTEMD_EXEC_PID", str(os.getppid()))
    root.setenv("INVOCATION_ID", "0123")
    assert "no/armd.toml" in first_error(capsys)
