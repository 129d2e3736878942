"""Everything is in pyproject.toml but this: with a library of compiled functions in it, the package
is for one kind of processor and one Python."""

from pathlib import Path

from setuptools import Distribution, setup


class Armd(Distribution):
    def has_ext_modules(self) -> bool:
        return any(Path("armd").glob("kernel_*.so"))


setup(distclass=Armd)
