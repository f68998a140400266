#!/usr/bin/env bash
# Fuzzes every parser that meets bytes from outside with libFuzzer, AddressSanitizer and UndefinedBehaviorSanitizer.
# usage: tests/fuzz/run.sh [--seconds N | --soak] [--jobs N] [TARGET...]
# Needs clang-16 and libclang-rt-16-dev (llvm-16 names the lines of what is found), see ./dev. Its corpora and findings are in
# build/soak/fuzz; soak.py describes the options.
set -euo pipefail
cd "$(dirname "$0")/../.."
export CCACHE_BASEDIR=$PWD CCACHE_NOHASHDIR=1 CCACHE_SLOPPINESS=time_macros CCACHE_DEPEND=1
mkdir -p build/soak/fuzz
cmake --preset fuzz >build/soak/fuzz.configure.log || { cat build/soak/fuzz.configure.log; exit 1; }
cmake --build build/fuzz -j "$(nproc)" --target fuzzers
exec python3 tests/fuzz/soak.py build/fuzz build/soak/fuzz "$@"
