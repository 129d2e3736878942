"""Everything is in pyproject.toml but this: a wheel carries the library of compiled functions, if
it can be made. It is then for one kind of processor and one Python."""

from __future__ import annotations

import functools
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.build_py import build_py

PROJECT = Path(__file__).resolve().parent


def make_library(folder: Path) -> Path | None:
    """The library of compiled functions in *folder*; None where it cannot be made, or shall not."""
    if os.environ.get("ARMD_WITHOUT_LIBRARY") or sys.platform != "linux":
        return None
    paths = [str(PROJECT), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {
        "PYTHONPATH": os.pathsep.join(paths),
        "PYTHONDONTWRITEBYTECODE": "1",
        "NUMBA_CACHE_DIR": str(folder / "cache"),
    }
    print("armd: compiling for arms of 3 to 9 joints: about a minute", flush=True)
    command = [sys.executable, "-m", "armd.compiled.ahead", "--into", str(folder)]
    done = subprocess.run(command, cwd=folder, env=os.environ | environment)
    libraries = list(folder.glob("kernel_*"))
    if done.returncode == 0 and libraries:
        return libraries[0]
    print("armd: no library of compiled functions: this wheel compiles when it is used", flush=True)
    return None


class Armd(Distribution):
    @functools.cached_property
    def library(self) -> Path | None:
        """Made once, and only for a wheel."""
        if "bdist_wheel" not in (getattr(self, "commands", None) or []):
            return None
        self._folder = tempfile.TemporaryDirectory()
        return make_library(Path(self._folder.name))

    def has_ext_modules(self) -> bool:
        return self.library is not None


class BuildWithLibrary(build_py):
    def run(self) -> None:
        super().run()
        package = Path(self.build_lib) / "armd"
        for earlier in package.glob("kernel_*"):  # of an earlier build in the same folder
            earlier.unlink()
        library = self.distribution.library
        if library is not None:
            self.copy_file(str(library), str(package / library.name))


setup(distclass=Armd, cmdclass={"build_py": BuildWithLibrary})
