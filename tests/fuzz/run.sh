#!/usr/bin/env bash
# Fuzzes the reader of VoxelNeXt weights with libFuzzer, AddressSanitizer and UndefinedBehaviorSanitizer.
# usage: tests/fuzz/run.sh [SECONDS]     (60 unless told); needs clang-16 and libclang-rt-16-dev, see ./dev.
# What it found worth keeping stays in build/fuzz/corpus, so that the next run goes on from there; an input that
# breaks something lies in build/fuzz/ as crash-*, oom-* or timeout-*.
set -euo pipefail
cd "$(dirname "$0")/../.."
seconds=${1:-60}
folder=build/fuzz
mkdir -p "$folder/corpus"
detector=mapping/src/detection/voxelnext

clang++-16 -std=c++20 -O1 -g1 -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all \
  -Imapping/include -Imapping/src -Imaps/include -isystem /usr/include/eigen3 -DFMT_HEADER_ONLY \
  tests/fuzz/voxelnext_weights.cpp "$detector"/{safetensors,config_text,weights,weights_file}.cpp \
  mapping/src/detection/strict_{json,value}.cpp \
  maps/src/box.cpp -o "$folder/voxelnext_weights"

# Seeds: the header and the config of the file that the tests read; its numbers would only slow the fuzzer down.
python3 - tests/data/voxelnext/weights.safetensors "$folder/corpus" <<'PY'
import json, pathlib, struct, sys
data = pathlib.Path(sys.argv[1]).read_bytes()
(length,) = struct.unpack("<Q", data[:8])
header = data[8 : 8 + length]
pathlib.Path(sys.argv[2], "header").write_bytes(header)
pathlib.Path(sys.argv[2], "config").write_text(json.loads(header)["__metadata__"]["config"])
PY
"$folder/voxelnext_weights" -max_total_time="$seconds" -max_len=16384 -rss_limit_mb=1024 -timeout=10 -print_final_stats=1 \
  -dict=tests/fuzz/voxelnext_weights.dict -artifact_prefix="$folder/" "$folder/corpus"
