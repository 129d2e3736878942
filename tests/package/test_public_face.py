"""`import armd`: every name of `__all__` is there, and the network only where it is used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import armd


def test_every_public_name_is_there() -> None:
    for name in armd.__all__:
        assert getattr(armd, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Poin'"):
        armd.Poin  # type: ignore[attr-defined] # noqa: B018


def test_a_command_without_network_does_not_load_one() -> None:
    script = "import sys, armd.daemon.commands.setup.check; print('zenoh' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "False\n"
