"""`armd completion` and `armd man`: every command and option is there; shells and man take them."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest

from armd.daemon.cli import main, make_parsers
from armd.daemon.commands.groups import COMMANDS


def said(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(list(words)) == 0
    return capsys.readouterr().out


def completed(script: str, line: str) -> set[str]:
    """What bash offers at the end of *line*."""
    ask = f"""{script}
COMP_LINE={line!r}; COMP_POINT=${{#COMP_LINE}}
COMP_WORDS=({line}{" ''" if line.endswith(" ") else ""}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
function=$(complete -p armd | sed 's/.*-F \\([^ ]*\\).*/\\1/')
$function armd "${{COMP_WORDS[COMP_CWORD]}}" "${{COMP_WORDS[COMP_CWORD - 1]}}"
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_bash_completes_commands_options_and_choices(capsys: pytest.CaptureFixture[str]) -> None:
    script = said(capsys, "completion", "bash")
    assert completed(script, "armd ver") == {"verify"}
    assert completed(script, "armd calibrate --the") == {"--thermal", "--thermal-method"}
    assert completed(script, "armd calibrate --thermal-method ") == {
        "polynomial", "zones", "components", "per-temperature",
    }  # fmt: skip


def test_every_shell_gets_every_command_and_option(capsys: pytest.CaptureFixture[str]) -> None:
    _, commands = make_parsers(COMMANDS.keys() - {"simulate"})
    options = {word for one in commands.values() for word in one.list_options()}
    assert len(options) > 60
    for shell in ("bash", "zsh", "fish"):
        script = said(capsys, "completion", shell)
        assert [name for name in COMMANDS if name not in script] == []
        assert [word for word in options if word.lstrip("-") not in script] == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shell_takes_its_script(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    script = said(capsys, "completion", shell)
    done = subprocess.run([shell, "-n"], input=script, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_man_page_has_what_help_has(capsys: pytest.CaptureFixture[str]) -> None:
    page = said(capsys, "man").replace("\\-", "-")
    _, commands = make_parsers(COMMANDS.keys() - {"simulate"})
    for name, command in commands.items():
        assert f".SS armd {name}\n" in page
        if name != "simulate":
            spellings = [word for a in command.arguments for word in a.option_strings]
            assert [word for word in spellings if word not in page] == []
    assert "  armd calibrate measured/T15 measured/T20 measured/T25 --arm arm.toml" in page
    assert "bad usage or bad input" in page


def test_man_shows_it(capsys: pytest.CaptureFixture[str]) -> None:
    if shutil.which("groff") is None:
        pytest.skip("no groff here")
    page = said(capsys, "man")
    done = subprocess.run(
        ["groff", "-k", "-man", "-Tutf8", "-ww"], input=page, capture_output=True, text=True
    )
    assert done.returncode == 0 and "warning" not in done.stderr
    assert "--thermal-method" in done.stdout


@pytest.mark.slow
def test_a_controllers_commands_start_and_are_all_in_the_help() -> None:
    """A program of its own, in which the packages that a controller lacks cannot be found."""
    ask = """
import sys
from armd.daemon.cli import OFFLINE, main

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in OFFLINE:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
sys.exit(main(sys.argv[1:]))
"""
    check = "from armd.daemon.start_check import main; sys.exit(main())"
    started = subprocess.run(
        [sys.executable, "-c", ask.replace("sys.exit(main(sys.argv[1:]))", check)],
        capture_output=True, text=True,
    )  # fmt: skip
    assert (started.returncode, started.stderr) == (0, "")
    for words in (["man"], ["completion", "bash"], ["completion", "fish"]):
        done = subprocess.run([sys.executable, "-c", ask, *words], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")
        assert "--future" not in done.stdout and "calibrate" in done.stdout
        assert "endpoint" in done.stdout
