#!/usr/bin/env bash
# What takes long: a minute of fuzzing for each parser, every test under the sanitizers, power cuts, kills, attackers and
# failing calls, ten minutes of overload, then the localizer on many streets. Each step leaves a mark in build/soak, so that
# a run that was cut off goes on where it was; `rm -r build/soak` starts afresh.
set -euo pipefail
marks=build/soak
mkdir -p "$marks"

step() { # step NAME COMMAND...
  local name=$1
  shift
  if [ -e "$marks/$name.done" ]; then echo "done before: $name"; return; fi
  echo "==> $name"
  "$@"
  touch "$marks/$name.done"
}

sanitized() { # sanitized PRESET
  cmake --preset "$1" -DSTILLMAP_TESTS=ON >"$marks/$1.configure.log"
  cmake --build "build/$1" -j "$(nproc)"
  ctest --preset "$1" -L unit
}

load() { # ten minutes of overload; one that others disturbed has not passed
  ctest --test-dir build/bench -R '^load.soak$' -V | tee "$marks/load.txt"
  ! grep -q 'not judged' "$marks/load.txt"
}

street() { # street SEED: map from day 1, queries from day 2
  local folder=$marks/street_$1 program=build/bench/stillmap
  rm -rf "$folder" && mkdir "$folder"
  "$program" simulate town -o "$folder/day1" --seed "$1" --scans 80
  "$program" simulate town -o "$folder/day2" --seed "$1" --day 2 --scans 80
  "$program" build "$folder/day1" -o "$folder/map"
  "$program" evaluate localization "$folder/map" "$folder/day2" --prior-error 1,5 --prior-error 2,10 --trials 5 \
    --seed "$1" --json="$marks/street_$1.json"
  rm -rf "$folder"
}

step fuzz tests/fuzz/run.sh
step asan sanitized asan
step tsan sanitized tsan
program=build/bench/stillmap packages=build/bench/tiny_packages
step power_cuts build/bench/power_cuts 1 10 "$marks/power_cuts"
step kills tests/soak/kills.py --program "$program" --packages "$packages" --seeds 1-20 --results "$marks/kills"
step rebuild_kills tests/soak/rebuild_kills.py --program "$program" --packages "$packages" --seeds 1-10 --kills 30 \
  --results "$marks/rebuild_kills"
step migration_kills tests/soak/migration_kills.py --program "$program" --packages "$packages" \
  --injector build/bench/libnth_call.so --kills 60
sample() { tests/integration/sample_map.sh "$program" "$marks/sample"; }
step sample sample
step unit_kills tests/soak/unit_kills.py --program "$program" --drive "$marks/sample/drive" --runs 50 -- \
  --detector geometric
sealed_drive() { # a street of 300 scans, every second of which is mapped
  rm -rf "$marks/sealed" && mkdir "$marks/sealed"
  "$program" simulate town -o "$marks/sealed/drive" --seed 3 --scans 300
  "$program" build "$marks/sealed/drive" -o "$marks/sealed/map" --select ::2
  "$program" store add "$marks/sealed/store" town v1 "$marks/sealed/map" --activate
}
step sealed_drive sealed_drive
step sealed_kills tests/soak/sealed_kills.py --program "$program" --store "$marks/sealed/store" \
  --drive "$marks/sealed/drive" --vehicles 200 --hz 0.3 --seconds 180 --kill-every 5
step shut_out tests/soak/shut_out.py --program "$program" --sample "$marks/sample"
for operation in add activate roll_back remove mend "add by command" "activate by command" "make a key" start import \
  "short rebuild"; do
  step "faults_${operation// /_}" tests/soak/faults.py --program "$program" --packages "$packages" \
    --injector build/bench/libnth_call.so --operation "$operation"
done
# Of a whole rebuild's some 4,900 calls a part; each takes as long as a rebuild.
step faults_rebuild tests/soak/faults.py --program "$program" --packages "$packages" \
  --injector build/bench/libnth_call.so --operation rebuild --sample 400
step load load
step realism ctest --test-dir build/bench -R '^accuracy.realism$' --output-on-failure
for seed in $(seq 100 119); do
  step "street_$seed" street "$seed"
done
python3 - "$marks" <<'PY'
import json, pathlib, sys
levels = [level for file in sorted(pathlib.Path(sys.argv[1]).glob("street_*.json"))
          for level in json.loads(file.read_text())["levels"]]
for prior in sorted({level["prior_error_m"] for level in levels}):
    chosen = [level for level in levels if level["prior_error_m"] == prior]
    queries = sum(level["queries"] for level in chosen)
    success = sum(level["success_rate"] * level["queries"] for level in chosen) / queries
    false_ok = sum(level["false_ok_rate"] * level["queries"] for level in chosen)
    print(f"{prior} m: {queries} queries on {len(chosen)} streets, another day: success {100 * success:.2f} %, "
          f"{false_ok:.0f} false ok")
PY
