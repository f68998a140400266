"""Builds the module with CMake, from the repository around this folder or from the copy of it in the sdist (cpp/)."""

import os
import pathlib
import shutil
import subprocess
import sys

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.sdist import sdist

HERE = pathlib.Path(__file__).resolve().parent
#: What the module is made of, in the repository.
SOURCES = ("cmake", "maps/CMakeLists.txt", "maps/include", "maps/json", "maps/rawlog", "maps/src", "localization/CMakeLists.txt",
           "localization/include", "localization/src")


def sources():
    copied = HERE / "cpp"
    return copied if copied.is_dir() else HERE.parent.parent


class BuildModule(build_ext):
    """A module that is there already, which STILLMAP_PYTHON_MODULE names, is taken as it is."""

    def build_extension(self, ext):
        target = pathlib.Path(self.get_ext_fullpath(ext.name)).resolve()
        target.parent.mkdir(parents=True, exist_ok=True)
        built = os.environ.get("STILLMAP_PYTHON_MODULE") or self.module_of_cmake()
        shutil.copyfile(built, target)

    def module_of_cmake(self):
        build = pathlib.Path(self.build_temp).resolve()
        subprocess.run(["cmake", "-S", HERE, "-B", build, f"-DSTILLMAP_SOURCES={sources()}", "-DCMAKE_BUILD_TYPE=Release",
                        f"-DPython_EXECUTABLE={sys.executable}"], check=True)
        subprocess.run(["cmake", "--build", build, "--target", "stillmap_python", "--parallel"], check=True)
        return next((build / "stillmap").glob("_native.*.so"))


class WithSources(sdist):
    def make_release_tree(self, base_dir, files):
        super().make_release_tree(base_dir, files)
        for folder in ("native", *(f"cpp/{each}" for each in SOURCES), "CMakeLists.txt"):
            name = pathlib.Path(folder)
            source = HERE / name if name.parts[0] != "cpp" else sources() / pathlib.Path(*name.parts[1:])
            target = pathlib.Path(base_dir) / name
            target.parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if source.is_dir() else shutil.copyfile)(source, target)


setup(ext_modules=[Extension("stillmap._native", sources=[])],
      cmdclass={"build_ext": BuildModule, "sdist": WithSources})
