#!/usr/bin/env bash
# Speed and accuracy beside the reference methods, each in the same run on the same map and with the same draws.
# usage: tests/bench/run.sh STILLMAP FOLDER
set -euo pipefail
program=$1 folder=$2
here=$(dirname "$0")
rm -rf "$folder" && mkdir -p "$folder"

bench() { # bench NAME DRIVE TRIALS
  local name=$1 drive=$2 trials=$3 method
  "$program" build "$drive" -o "$folder/$name" --select ::2 --json "$folder/$name.build.json"
  for method in default pcl-icp; do
    "$program" evaluate localization "$folder/$name" "$drive" --select 1::2 --method "$method" --threads 1 \
      --prior-error 0.3,2 --prior-error 1,5 --prior-error 2,10 --trials "$trials" --seed 1 \
      --json "$folder/$name.$method.json"
  done
  python3 "$here/table.py" "$folder" "$name"
}

"$program" simulate town -o "$folder/drive" --seed 7 --scans 80
bench town "$folder/drive" 1
if [ -n "${STILLMAP_REAL_DATA:-}" ]; then
  bench kitti_0013 "$STILLMAP_REAL_DATA/kitti_raw/2011_09_26/2011_09_26_drive_0013_sync" 1
  bench mulran_seosan01 "$STILLMAP_REAL_DATA/mulran_seosan01" 1
fi
