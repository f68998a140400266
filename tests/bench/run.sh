#!/usr/bin/env bash
# Speed and accuracy beside the reference methods, each in the same run on the same map and with the same draws.
# usage: tests/bench/run.sh STILLMAP FOLDER
#
# On KITTI 0013 twice: against the drive's own poses, which slide, and against poses that no method of ours takes part in
# (tests/accuracy/reference_poses.cpp, built beside STILLMAP). That program prints how well its poses repeat and how many
# scans it dropped for not repeating within 3 cm; only the rest are asked for:
#   reference_poses DRIVE --select 1::2 -o REFERENCE.tum
#   stillmap evaluate localization MAP DRIVE --select 1::2 --poses REFERENCE.tum
# And once more in a map whose poses are our odometry's, with a reference made from these.
set -euo pipefail
program=$1 folder=$2
here=$(dirname "$0")
rm -rf "$folder" && mkdir -p "$folder"

build() { # build NAME DRIVE [OPTION...]
  local name=$1 drive=$2
  shift 2
  "$program" build "$drive" -o "$folder/$name" --select ::2 --json="$folder/$name.build.json" "$@"
}

measure() { # measure RESULT NAME DRIVE TRIALS [OPTION...]
  local result=$1 name=$2 drive=$3 trials=$4 method
  shift 4
  for method in default pcl-icp ndt gicp; do
    "$program" evaluate localization "$folder/$name" "$drive" --select 1::2 --method "$method" --threads 1 \
      --prior-error 0.3,2 --prior-error 1,5 --prior-error 2,10 --trials "$trials" --seed 1 \
      --json="$folder/$result.$method.json" "$@"
  done
  python3 "$here/table.py" "$folder" "$name" "$result"
}

bench() { # bench NAME DRIVE TRIALS
  build "$1" "$2"
  measure "$1" "$1" "$2" "$3"
}

bench_with_odometry() { # bench_with_odometry NAME DRIVE TRIALS
  build "$1" "$2" --odometry default
  "$program" evaluate odometry "$2" --trajectory "$folder/$1.path.tum" --json="$folder/$1.odometry.json"
  "$(dirname "$program")/reference_poses" "$2" --poses "$folder/$1.path.tum" --select 1::2 \
    -o "$folder/$1.reference.tum" --json "$folder/$1.reference.json"
  measure "$1" "$1" "$2" "$3" --poses "$folder/$1.reference.tum"
}

bench_with_reference() { # bench_with_reference NAME DRIVE TRIALS
  bench "$@"
  "$(dirname "$program")/reference_poses" "$2" --select 1::2 -o "$folder/$1.reference.tum" \
    --json "$folder/$1.reference.json"
  measure "$1.independent" "$1" "$2" "$3" --poses "$folder/$1.reference.tum"
}

"$program" simulate town -o "$folder/drive" --seed 7 --scans 80
bench town "$folder/drive" 1
if [ -n "${STILLMAP_REAL_DATA:-}" ]; then
  bench_with_reference kitti_0013 "$STILLMAP_REAL_DATA/kitti_raw/2011_09_26/2011_09_26_drive_0013_sync" 1
  bench_with_odometry kitti_0013_odometry "$STILLMAP_REAL_DATA/kitti_raw/2011_09_26/2011_09_26_drive_0013_sync" 1
  bench mulran_seosan01 "$STILLMAP_REAL_DATA/mulran_seosan01" 1
fi

# Odometry, loops and pose graph: speed and errors.
"$program" simulate town -o "$folder/odometry" --seed 111 --scans 1500
for method in default loam; do
  "$program" evaluate odometry "$folder/odometry" --odometry "$method" --json="$folder/odometry.$method.json"
done
"$(dirname "$program")/pose_graph_bench"
