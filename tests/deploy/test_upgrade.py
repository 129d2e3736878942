"""An upgrade is whole or it is not there: `deploy/install.sh` with the system's programs replaced
by ones that note what they are asked, in a file system of its own (test_install.py: the real)."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[2]

#: Of this machine only what the script writes to is another.
ENTER = """\
for folder in opt usr/local etc/systemd; do
    mkdir -p "/$folder" 2>/dev/null || true
    mount --bind "$1/root/$folder" "/$folder"
done
mount -t tmpfs tmpfs /var/cache
mount -t tmpfs tmpfs /run; mkdir -p /run/systemd/system
mount --bind "$1/root/armd" /etc/armd 2>/dev/null || true
cd "$1/here"
folder=$1 project=$2; shift 2
PATH="$folder/bin:$PATH" PYTHON="$folder/bin/python3" exec sh "$project/deploy/install.sh" "$@"
"""
PYTHON = """\
#!/bin/sh
echo "$0 $*" >>{folder}/asked
case "$*" in
    "-I -m venv "*) mkdir -p "$4/bin"; cp "$0" "$4/bin/python"; : >"$4/bin/armd" ;;
    "-I -m pip "*"--constraint"*)
        [ ! -e {folder}/fail-pip ] && cp {folder}/version "${{0%/bin/*}}/" ;;
    "-I -m armd.daemon.start_check") [ ! -e {folder}/fail-load ] ;;
    "-I -c import importlib.util as i, sys; sys.exit(not i.find_spec("*numba*)
        [ -e {folder}/has-numba ] ;;
    "-I -m armd "*)
        [ ! -e {folder}/fail-help ] && shift 3 && echo "$* of $(cat {folder}/version)" ;;
    "-I "*) ;;
    *) echo "not isolated: $*" >&2; exit 9 ;;
esac
"""
SYSTEMCTL = """\
#!/bin/sh
case "$*" in
    "list-units "*) if [ -e {folder}/running ]; then echo armd.service; fi ;;
    "restart "*)
        echo "restart $(cat /opt/armd/version)" >>{folder}/asked
        [ "$(cat /opt/armd/version)" != broken ] ;;
esac
"""
QUIET = "#!/bin/sh\nexit 0\n"


class Machine:
    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("bin", "wheels", "here", "root/opt", "root/usr/local"):
            (folder / name).mkdir(parents=True)
        (folder / "root/armd").mkdir()
        (folder / "root/etc/systemd/system").mkdir(parents=True)
        programs = {"python3": PYTHON, "systemctl": SYSTEMCTL}
        programs |= dict.fromkeys(["systemd-sysusers", "udevadm", "chown", "chmod"], QUIET)
        programs["setpriv"] = '#!/bin/sh\necho "setpriv $*" >>{folder}/asked\n'
        # The group armd is not this machine's.
        programs["install"] = (
            '#!/bin/sh\ncase "$*" in *" -g "*) exit 0;; esac\nexec /usr/bin/install "$@"\n'
        )
        for name, text in programs.items():
            (folder / "bin" / name).write_text(
                text.replace("{folder}", str(folder)).replace("{{", "{").replace("}}", "}")
            )
            (folder / "bin" / name).chmod(0o755)

    def install(self, version: str) -> subprocess.CompletedProcess[str]:
        (self.folder / "version").write_text(version)
        return self.run("--wheelhouse", str(self.folder / "wheels"))

    def run(self, *options: str) -> subprocess.CompletedProcess[str]:
        (self.folder / "asked").write_text("")
        enter = ["unshare", "-Urm", "sh", "-euc", ENTER, "sh", self.folder, PROJECT, *options]
        return subprocess.run(enter, capture_output=True, text=True, timeout=60, check=False)

    def local(self) -> list[str]:
        """Files and folders below /usr/local."""
        root = self.folder / "root/usr/local"
        return sorted(str(path.relative_to(root)) for path in root.rglob("*"))

    @property
    def asked(self) -> str:
        return (self.folder / "asked").read_text()

    @property
    def opt(self) -> Path:
        return self.folder / "root/opt"

    def version(self) -> str:
        """Of the program that `/opt/armd` leads to."""
        link = self.opt / "armd"
        return (self.opt / link.readlink().name / "version").read_text()

    def fail(self, what: str) -> None:
        (self.folder / f"fail-{what}").touch()

    def unit(self) -> Path:
        return self.folder / "root/usr/local/lib/systemd/system/armd.service"

    def help_files(self) -> dict[str, str]:
        """What shells complete and `man` shows."""
        share = self.folder / "root/usr/local/share"
        return {
            str(path.relative_to(share)): path.read_text().strip()
            for path in share.rglob("*")
            if path.is_file()
        }


def help_of(version: str) -> dict[str, str]:
    """By the paths in which Debian's shells and man look, below /usr/local/share."""
    return {
        "bash-completion/completions/armd": f"completion bash of {version}",
        "zsh/site-functions/_armd": f"completion zsh of {version}",
        "fish/vendor_completions.d/armd.fish": f"completion fish of {version}",
        "man/man1/armd.1": f"man of {version}",
    }


#: Shells make it for completions of this machine's own, as Debian's zsh does.
OF_ZSH = "share/zsh/site-functions"


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    if subprocess.run(["unshare", "-Urm", "true"], check=False).returncode:
        pytest.skip("this machine lets nobody have mounts of its own")
    made = Machine(tmp_path)
    (tmp_path / "root/usr/local" / OF_ZSH).mkdir(parents=True)
    done = made.install("1")
    assert done.returncode == 0, done.stderr
    (tmp_path / "running").touch()
    made.unit().write_text("unit of 1")
    return made


def test_an_upgrade_is_built_beside_and_leaves_nothing_of_the_old(machine: Machine) -> None:
    done = machine.install("2")
    assert done.returncode == 0, done.stderr
    assert machine.version() == "2"
    assert sorted(path.name for path in machine.opt.iterdir()) == ["armd", "armd.b"]
    asked = machine.asked.splitlines()
    (ahead,) = (line for line in asked if line.endswith("-m armd.compiled.ahead"))
    assert ahead.startswith("setpriv --reuid=armd ") and "/opt/armd.b/bin/python -I" in ahead
    assert asked.index(ahead) < asked.index("restart 2")
    assert asked[-1].endswith("-m armd.compiled.ahead --tidy")  # the old one's are not needed now
    assert machine.unit().read_text() != "unit of 1"
    assert machine.help_files() == help_of("2")


def test_the_help_goes_with_its_program(machine: Machine) -> None:
    assert machine.help_files() == help_of("1")
    machine.install("broken")
    assert machine.help_files() == help_of("1")
    machine.fail("help")  # of a program that is good otherwise
    done = machine.install("2")
    assert done.returncode == 0 and "armd man: found an error" in done.stderr
    assert machine.version() == "2" and machine.help_files() == {}


@pytest.mark.parametrize("what", ["pip", "load"])
def test_one_that_cannot_be_built_leaves_the_old_as_it_was(machine: Machine, what: str) -> None:
    machine.fail(what)
    done = machine.install("2")
    assert done.returncode != 0
    assert machine.version() == "1" and "restart" not in machine.asked
    assert sorted(path.name for path in machine.opt.iterdir()) == ["armd", "armd.a"]
    assert machine.unit().read_text() == "unit of 1"


def test_one_that_does_not_start_is_taken_back(machine: Machine) -> None:
    done = machine.install("broken")
    assert done.returncode == 2
    assert "found a service that does not start (armd.service)" in done.stderr
    assert machine.version() == "1" and machine.asked.endswith("restart broken\nrestart 1\n")
    assert "--tidy" not in machine.asked
    assert sorted(path.name for path in machine.opt.iterdir()) == ["armd", "armd.a"]
    assert machine.unit().read_text() == "unit of 1"


def test_an_installation_of_before_becomes_one_of_now(machine: Machine) -> None:
    link = machine.opt / "armd"
    slot = machine.opt / link.readlink().name
    link.unlink()
    slot.rename(link)
    done = machine.install("2")
    assert done.returncode == 0, done.stderr
    assert machine.version() == "2"
    assert sorted(path.name for path in machine.opt.iterdir()) == ["armd", "armd.a"]


def test_root_runs_no_python_of_the_present_folder(machine: Machine) -> None:
    (machine.folder / "here/venv.py").write_text("raise SystemExit('taken over')")
    assert machine.install("2").returncode == 0
    lines = [line for line in machine.asked.splitlines() if "python" in line]
    assert len(lines) >= 6 and all(" -I " in line for line in lines)


def compiling(machine: Machine) -> list[str]:
    """The files that let units execute what was written to memory."""
    return [path for path in machine.local() if path.endswith("-compiles.conf")]


@pytest.mark.slow
def test_memory_may_be_executed_where_numba_is_installed_and_there_alone(machine: Machine) -> None:
    units = "lib/systemd/system/"
    both = [
        f"{units}armd.service.d/armd-compiles.conf",
        f"{units}armd@.service.d/armd@-compiles.conf",
    ]
    assert compiling(machine) == []
    numba = machine.folder / "has-numba"
    numba.touch()
    assert machine.install("broken").returncode != 0
    assert compiling(machine) == []  # put back
    assert machine.install("2").returncode == 0
    assert compiling(machine) == both
    for path in both:
        lines = (machine.folder / "root/usr/local" / path).read_text().splitlines()
        assert lines[-2:] == ["[Service]", "MemoryDenyWriteExecute=no"]
    numba.unlink()
    assert machine.install("broken").returncode != 0
    assert compiling(machine) == both  # put back
    assert machine.install("3").returncode == 0
    assert not [path for path in machine.local() if ".service.d" in path]


def test_only_folders_that_it_made_go_with_it(machine: Machine) -> None:
    machine.fail("pip")
    (machine.folder / "has-numba").touch()
    assert machine.install("2").returncode != 0
    (machine.folder / "fail-pip").unlink()
    assert machine.install("broken").returncode != 0  # and put back
    assert machine.install("3").returncode == 0
    assert "lib/udev/rules.d/70-armd.rules" in machine.local()
    done = machine.run("--uninstall")
    assert done.returncode == 0, done.stderr
    assert machine.local() == ["bin", "share", "share/zsh", OF_ZSH]
    assert list(machine.opt.iterdir()) == []
