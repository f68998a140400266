#!/usr/bin/env bash
# Fuzzes parsers with libFuzzer, AddressSanitizer and UndefinedBehaviorSanitizer, each from its seeds.
# usage: tests/fuzz/run.sh [--seconds N] [TARGET...]     by default 60 s each, and every target
# Needs clang-16 and libclang-rt-16-dev; with llvm-16 a report names source lines. `./dev soak` installs them.
# An input that breaks something, takes over 5 s or over 512 MiB is kept in build/fuzz_found/TARGET; the exit code is 1 then.
set -euo pipefail
cd "$(dirname "$0")/../.."
fail() { printf 'run.sh: %s\n' "$*" >&2; exit 2; }
seconds=60 targets=()
while [ $# -gt 0 ]; do
  case $1 in
    --seconds)
      seconds=${2:-}
      [[ $seconds =~ ^[1-9][0-9]*$ ]] || fail "--seconds: found '$seconds'; give a whole number, as in --seconds 60"
      shift ;;
    -*) fail "found '$1'; usage: tests/fuzz/run.sh [--seconds N] [TARGET...]" ;;
    *) targets+=("$1") ;;
  esac
  shift
done
mapfile -t known < <(basename -s .cpp tests/fuzz/*.cpp | grep -vx replay)
[ ${#targets[@]} -gt 0 ] || targets=("${known[@]}")
for target in "${targets[@]}"; do
  printf '%s\n' "${known[@]}" | grep -qx -- "$target" || fail "no target '$target'; the targets are ${known[*]}"
done

export CCACHE_BASEDIR=$PWD CCACHE_NOHASHDIR=1 CCACHE_SLOPPINESS=time_macros CCACHE_DEPEND=1
mkdir -p build
cmake --preset fuzz >build/fuzz.configure.log || { cat build/fuzz.configure.log; exit 1; }
cmake --build build/fuzz -j "$(nproc)" --target "${targets[@]/#/fuzz_}"
tests/fuzz/seeds.py build/fuzz/seeds

# AddressSanitizer keeps freed memory, by default half of what one input may take.
export ASAN_OPTIONS=quarantine_size_mb=32 UBSAN_OPTIONS=print_stacktrace=1
ASAN_SYMBOLIZER_PATH=$(command -v llvm-symbolizer-16) && export ASAN_SYMBOLIZER_PATH
broken=()
for target in "${targets[@]}"; do
  found=build/fuzz_found/$target
  options=(-max_total_time="$seconds" -max_len=4096 -timeout=5 -rss_limit_mb=512 -artifact_prefix="$found/" -print_final_stats=1)
  [ ! -e "tests/fuzz/$target.dict" ] || options+=(-dict="tests/fuzz/$target.dict")
  # Its threads go on after an input, and LeakSanitizer before LLVM 20 sometimes overlooks what one holds
  # (llvm/llvm-project#112807). Leaks are looked for once, at the end, when the threads have ended.
  [ "$target" != http ] || options+=(-detect_leaks=0)
  mkdir -p "$found"
  if "build/fuzz/fuzz_$target" "${options[@]}" "build/fuzz/seeds/$target" >"$found/log" 2>&1; then
    echo "$target: $(sed -n 's/^stat::number_of_executed_units: *//p' "$found/log") inputs, nothing found"
  else
    broken+=("$target")
    tail -n 40 "$found/log"
    echo "$target: FAILED; give the input in $found to build/fuzz/fuzz_$target again"
  fi
done
[ ${#broken[@]} -eq 0 ] || exit 1
