#!/usr/bin/env bash
# wheel.sh REPOSITORY MODULE PYTHON: the package is strictly typed and its stubs fit the module; without a network, sdist
# and wheel are made, the wheel can be installed and imported, and the sdist holds all that CMake needs to configure.
set -euo pipefail
"$3" -c 'import build, mypy, numpy, pybind11, setuptools, venv, wheel' 2>/dev/null ||
  { echo "skipped: python3-build, python3-venv, python3-pybind11, python3-numpy, python3-wheel or mypy is not installed"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# As in the repository, so that setup.py finds the C++ sources, but without build folders of its own in it.
mkdir -p "$work/repository"
cp -r --parents -t "$work/repository" "$1/localization" "$1/maps" "$1/cmake"
cd "$work/repository$1/localization/python"

cp "$2" src/stillmap/
"$3" -m mypy --cache-dir "$work/mypy" src
MYPYPATH=src PYTHONPATH=src "$3" -m mypy.stubtest --mypy-config-file pyproject.toml stillmap._native \
  --ignore-missing-stub --allowlist "$1/tests/python/stubtest_allowlist.txt"
rm src/stillmap/_native.*.so

offline=()
! unshare -rn true 2>/dev/null || offline=(unshare -rn) # where the kernel lets us, without any network
STILLMAP_PYTHON_MODULE=$2 "${offline[@]}" "$3" -m build --no-isolation --skip-dependency-check -o "$work/dist" . >"$work/log" 2>&1 ||
  { cat "$work/log"; exit 1; }
"$3" -m venv --system-site-packages "$work/venv"
"$work/venv/bin/pip" install --quiet --no-index --no-deps --disable-pip-version-check "$work"/dist/stillmap-*.whl
cd "$work"
"$work/venv/bin/python" -c "import pathlib, stillmap
folder = pathlib.Path(stillmap.__file__).parent
assert str(folder).startswith('$work/venv'), folder
assert {'py.typed', '_native.pyi'} <= {file.name for file in folder.iterdir()}, list(folder.iterdir())
assert stillmap.Scan(__import__('numpy').ones((5, 3), 'float32')).points.shape == (5, 3)"

tar xzf "$work"/dist/stillmap-*.tar.gz
cd stillmap-*/
for folder in cmake maps/src maps/include maps/json maps/rawlog localization/src localization/include; do
  diff -r "$1/$folder" "cpp/$folder"
done
diff -r "$1/localization/python/native" native
cmake -S . -B "$work/configured" -DSTILLMAP_SOURCES="$PWD/cpp" -DPython_EXECUTABLE="$3" >"$work/log" 2>&1 ||
  { cat "$work/log"; exit 1; }
echo "$(basename "$work"/dist/stillmap-*.whl) and $(basename "$work"/dist/stillmap-*.tar.gz) are whole"
