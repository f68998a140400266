#!/usr/bin/env bash
# python_package.sh PACKAGE PYTHON: mypy --strict finds nothing; sdist and wheel are made without a network, the wheel
# from the sdist alone, and the wheel holds all and can be imported.
set -euo pipefail
"$2" -c 'import setuptools, wheel, pip, mypy' 2>/dev/null ||
  { echo "skipped: python3-setuptools, python3-wheel, python3-pip or mypy is not installed"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp -r "$1" "$work/package"
cd "$work/package"
"$2" -m mypy --cache-dir "$work/mypy" src
"$2" -c 'import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])' "$work" >/dev/null
sdist=$(echo "$work"/stillmap*client-*.tar.gz)
rm -rf "$work/package"
cd "$work"
"$2" -m pip wheel --quiet --no-build-isolation --no-deps --no-index --disable-pip-version-check -w "$work" "$sdist"
wheel=$(echo "$work"/stillmap_client-*-py3-none-any.whl)
"$2" -c "import sys; sys.path.insert(0, '$wheel')
import stillmap_client, zipfile
assert stillmap_client.__file__.startswith('$wheel'), stillmap_client.__file__
assert 'stillmap_client/py.typed' in zipfile.ZipFile('$wheel').namelist()
stillmap_client.Client('http://127.0.0.1:1')"
echo "$(basename "$sdist") and $(basename "$wheel") are whole"
