#!/usr/bin/env bash
# sample_map.sh STILLMAP FOLDER: simulates a short drive and maps its even scans, as `./dev demo` does with a longer one.
set -euo pipefail
rm -rf "$2"
mkdir -p "$2/store"
"$1" simulate town -o "$2/drive" --seed 1 --scans 40
"$1" build "$2/drive" -o "$2/map" --select ::2
"$1" store add "$2/store" town v1 "$2/map" --activate
