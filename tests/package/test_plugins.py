"""Entry points of other packages: what works is found, what does not is reported once and skipped,
and armd's own names cost and mean what they did."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from support.other_packages import TEMPLATE, armd_with, environment_with, make_package
from support.pages import page_path, run_as_typed, shell_blocks

ROOT = Path(__file__).parents[2]
ARM = (
    'schema = "armd.arm/1"\nserial_number = "A-1"\n'
    + 3 * "[[joint]]\na_mm = 100.0\ncounts_per_turn = 4096\n"
    + "[tip]\noffset_mm = [0, 0, 1]\n"
)
#: One of each way to be broken; what is said of it: its entry point, what was found, expected.
BROKEN = """\
[armd.commands]
gone = no_such_module
ends = broken:ends
without = broken
run = broken
[armd.drivers]
lazy = broken:Lazy
serial = broken
[armd.causes]
link_expansion = broken
odd = broken:odd
"""
MODULE = """\
class Lazy: pass
odd = 3
def __getattr__(name):
    if name == "ends":
        raise SystemExit(3)
    raise AttributeError(name)
"""


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_package(tmp_path_factory.mktemp("broken"), "broken", BROKEN, MODULE)


def daemon_file(folder: Path, driver: str) -> Path:
    (folder / "arm.toml").write_text(ARM)
    path = folder / "armd.toml"
    path.write_text(f'schema = "armd.daemon/1"\narm = "arm.toml"\n[driver]\n{driver}\n')
    return path


def test_broken_commands_are_reported_once_and_the_list_is_printed(broken: Path) -> None:
    done = armd_with(broken, "--help")
    assert done.returncode == 0 and "calibrate" in done.stdout
    for name in ("gone", "ends", "without"):
        assert not re.search(rf"^ +{name} ", done.stdout, re.MULTILINE)
    lines = sorted(done.stderr.splitlines())
    assert [line.partition(", expected ")[0] for line in lines] == [
        "armd: package broken 1.0: armd.commands ends: found SystemExit: 3",
        "armd: package broken 1.0: armd.commands gone: found ModuleNotFoundError: No module named"
        " 'no_such_module'",
        "armd: package broken 1.0: armd.commands run: found a name that armd itself has",
        f"armd: package broken 1.0: armd.commands without: found no HELP in"
        f" <module 'broken' from '{broken}/broken.py'>",
    ]
    assert all(line.endswith("; skipped") for line in lines)


@pytest.mark.slow
def test_a_name_of_armds_own_keeps_its_meaning(broken: Path, tmp_path: Path) -> None:
    """No package is even looked for."""
    done = armd_with(broken, "run", str(tmp_path / "missing.toml"))
    assert done.returncode == 2 and "package" not in done.stderr
    assert done.stderr.startswith(f"armd: {tmp_path}/missing.toml: the file: found nothing")
    driver = daemon_file(tmp_path, 'kind = "serial"\nport = "/dev/x"')
    done = armd_with(broken, "check", str(driver))
    assert (done.returncode, done.stderr) == (0, "")


def test_a_driver_that_is_none_is_bad_input(broken: Path, tmp_path: Path) -> None:
    path = daemon_file(tmp_path, 'kind = "lazy"')
    done = armd_with(broken, "run", str(path))
    assert done.returncode == 2
    *reported, last = done.stderr.splitlines()
    assert len(reported) == 2  # the name that is taken, and the class that is no driver
    assert "armd.drivers serial: found a name that armd itself has" in done.stderr
    expected = "expected a class that is based on armd.drivers.plugin.DriverPlugin; skipped"
    assert "armd.drivers lazy: found <class 'broken.Lazy'>" in done.stderr
    assert any(line.endswith(expected) for line in reported)
    assert last.startswith(f"armd: {path}: driver.kind: found 'lazy', expected one of 'serial', ")


def test_causes_that_are_none_leave_the_catalogue_as_it_is(broken: Path) -> None:
    script = "from armd.compensation.effects.catalogue import CATALOGUE; print(*CATALOGUE)"
    command = [sys.executable, "-c", script]
    done = [
        subprocess.run(
            command, env=environment_with(folder), capture_output=True, text=True, check=True
        )
        for folder in (broken, broken / "nothing")
    ]
    assert done[0].stdout == done[1].stdout and "link_expansion" in done[0].stdout
    assert [line.partition(", expected ")[0] for line in done[0].stderr.splitlines()] == [
        "armd: package broken 1.0: armd.causes link_expansion: found a name that armd itself has",
        "armd: package broken 1.0: armd.causes odd: found 3",
    ]


def test_of_two_packages_with_one_name_the_first_is_taken(tmp_path: Path) -> None:
    module = "HELP = 'say {0}'\ndef add_arguments(p): pass\ndef run(a): print('{0}')\n"
    for name in ("first", "second"):
        entry = f"[armd.commands]\ngreet = {name}\n"
        make_package(tmp_path, name, entry, module.format(name))
    done = armd_with(tmp_path, "greet")
    assert (done.returncode, done.stdout) == (0, "first\n")
    found = "package second 1.0: armd.commands greet: found a name that package first 1.0 has"
    assert done.stderr.startswith(f"armd: {found}, expected a name of its own")


def test_a_command_that_raises_names_its_package(tmp_path: Path) -> None:
    module = "HELP = 'h'\ndef add_arguments(p): pass\ndef run(a): {}['x']\n"
    make_package(tmp_path, "raising", "[armd.commands]\nraise = raising\n", module)
    done = armd_with(tmp_path, "raise")
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 70 and "raising.py" in done.stderr
    assert last.startswith("armd: KeyError: this is a fault of package raising 1.0, not of")
    done = armd_with(tmp_path, "raise", "--nonsense")
    assert done.returncode == 2 and "found --nonsense, expected an option" in done.stderr


#: What a daemon does before it opens its line, and the modules that it has loaded by then.
START = """
import sys
from armd.daemon.commands.service import run
from armd.daemon.config import load_config
from armd.drivers.table import open_driver
config = load_config(sys.argv[1])
open_driver(config.driver, config.expectation).close()
print([name for name in sys.modules if name.startswith("armd.plugins")])
"""


@pytest.mark.slow
def test_a_daemon_of_armds_own_drivers_looks_for_no_package(tmp_path: Path) -> None:
    path = daemon_file(tmp_path, 'kind = "serial"\nport = "/dev/x"')
    command = [sys.executable, "-c", START, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.slow
def test_the_page_installs_the_template(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As typed, but that pip installs into a folder of this test's."""
    text = page_path("plugins").read_text(encoding="utf-8")
    (commands,) = shell_blocks(text)
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "installed"))
    monkeypatch.setenv("PIP_TARGET", str(tmp_path / "installed"))
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    said = run_as_typed(commands, tmp_path)
    assert re.search(r"^ +webhook +post each measurement as JSON to a URL", said, re.MULTILINE)
    path = daemon_file(tmp_path, 'kind = "udp"\nport = 5005')
    assert armd_with(tmp_path / "installed", "check", str(path)).returncode == 0
    path = daemon_file(tmp_path, 'kind = "udp"\nport = "5005"\nspeed = 3')
    done = armd_with(tmp_path / "installed", "check", str(path))
    assert done.returncode == 1 and f"{path}: driver.port: found '5005', expected" in done.stderr
    assert f"{path}: driver.speed: found an unknown key" in done.stderr
    path = daemon_file(tmp_path, 'kind = "upd"\nport = 5005')
    done = armd_with(tmp_path / "installed", "run", str(path))
    assert done.returncode == 2 and done.stderr.endswith("'microscribe', 'replay', 'udp'\n")


def test_the_template_is_short() -> None:
    modules = list(TEMPLATE.rglob("*.py"))
    assert {path.name for path in modules} == {
        "__init__.py", "driver.py", "command.py", "cause.py",
    }  # fmt: skip
    assert all(len(path.read_text().splitlines()) <= 50 for path in modules)
