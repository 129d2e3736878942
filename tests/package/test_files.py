"""Output files: whole or not at all, nothing replaced that is no file, nothing opened to others."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from armd import BadInput
from armd.files.writing import check_place, replace_file, write_changed, write_whole


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def leftovers(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize("umask", [0o022, 0o077])
def test_a_new_file_is_as_the_umask_wants_it(tmp_path: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        write_whole(tmp_path / "file", "x")
    finally:
        os.umask(before)
    assert mode(tmp_path / "file") == 0o666 & ~umask


@pytest.mark.parametrize("permissions", [0o600, 0o640, 0o664, 0o755])
def test_permissions_stay_as_they_were(tmp_path: Path, permissions: int) -> None:
    path = tmp_path / "file"
    path.write_text("old")
    path.chmod(permissions)
    seen = []
    with replace_file(path) as part:
        seen.append(mode(part))
        part.write_text("new")
    assert seen == [0o600]  # nobody else reads along while it is written
    assert (path.read_text(), mode(path)) == ("new", permissions)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_the_owner_stays(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")
    os.chown(path, 1234, 5678)
    write_whole(path, "new")
    assert (path.stat().st_uid, path.stat().st_gid) == (1234, 5678)


def test_another_s_group_is_not_replaced_by_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    path.write_text("old")
    path.chmod(0o664)

    def refuse(*_: object) -> None:
        raise PermissionError(errno.EPERM, "no")

    monkeypatch.setattr(os, "chown", refuse)
    write_whole(path, "new")
    assert mode(path) == 0o644


def test_what_fails_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")
    with pytest.raises(RuntimeError), replace_file(path) as part:
        part.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert leftovers(tmp_path) == []


def test_a_full_disk_is_told_and_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("old")
    with (
        pytest.raises(BadInput, match="found no space left on its disk, expected room for it"),
        replace_file(path) as part,
    ):
        part.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert path.read_text() == "old"
    assert leftovers(tmp_path) == []
    with pytest.raises(BadInput, match="no space left"):
        write_whole("/dev/full", "x")


def test_the_longest_name_can_be_written(tmp_path: Path) -> None:
    write_whole(tmp_path / ("x" * 255), "x")
    with pytest.raises(BadInput, match="a name too long"):
        write_whole(tmp_path / ("x" * 256), "x")
    with pytest.raises(BadInput, match="a zero byte"):
        write_whole(tmp_path / "a\x00b", "x")


def test_a_link_is_refused_and_its_end_named(tmp_path: Path) -> None:
    end = tmp_path / "end"
    end.write_text("old")
    for link, target in (("link", end), ("dangling", tmp_path / "none"), ("loop", "loop")):
        (tmp_path / link).symlink_to(target)
        with pytest.raises(BadInput, match=r"a symbolic link to .*, expected a file: name "):
            write_whole(tmp_path / link, "new")
    assert end.read_text() == "old"
    assert (tmp_path / "link").is_symlink()
    assert not (tmp_path / "none").exists()


def test_a_device_is_written_to_and_stays_a_device(tmp_path: Path) -> None:
    write_whole("/dev/null", "x")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    (tmp_path / "link").symlink_to("/dev/null")
    write_whole(tmp_path / "link", "x")
    assert (tmp_path / "link").is_symlink()


def test_a_pipe_is_written_to(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(BadInput, match="a pipe that nobody reads"):
        write_whole(pipe, "x")
    heard: list[str] = []
    reader = threading.Thread(target=lambda: heard.append(pipe.read_text()))
    reader.start()
    while True:  # until the reader has opened its end
        try:
            write_whole(pipe, "all of it")
            break
        except BadInput:
            pass
    reader.join()
    assert heard == ["all of it"]


@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_standard_output_goes_where_the_shell_sent_it(tmp_path: Path, name: str) -> None:
    script = (
        "from armd.files.writing import write_whole; print('first');"
        f"write_whole({name!r}, 'second\\n'); print('third')"
    )
    out = tmp_path / "out"
    out.write_text("0\n")
    with out.open("a") as file:
        subprocess.run([sys.executable, "-c", script], stdout=file, check=True)
    assert out.read_text() == "0\nfirst\nsecond\nthird\n"
    piped = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True)
    assert piped.stdout == b"first\nsecond\nthird\n"


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("none/file", "the folder: found nothing"),
        ("file/x", "found a file where its path has a folder"),
        (".", "a folder, expected a file"),
        ("/proc/armd", "the folder|a place"),
        ("", "a folder, expected a file"),
    ],
)
def test_what_cannot_be_written_is_told_before(tmp_path: Path, name: str, found: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BadInput, match=found):
        check_place(tmp_path / name)
        write_whole(tmp_path / name, "x")  # /proc says so only when asked


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_place_is_told_before(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "file").chmod(0o444)
    with pytest.raises(BadInput, match="write-protected"):
        check_place(tmp_path / "file")
    tmp_path.chmod(0o555)
    with pytest.raises(BadInput, match="no permission to write in it"):
        check_place(tmp_path / "new")
    tmp_path.chmod(0o755)


def test_a_pipe_where_a_file_is_kept_is_never_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(BadInput):
        write_changed(tmp_path / "pipe", "x")
