#!/usr/bin/env bash
# lint.sh DOCUMENT: Redocly (npm, pinned) finds no error in it. 77 = npm, or its packages, cannot be had here.
set -euo pipefail
document=$(realpath "$1")
cd "$(dirname "$0")"
export REDOCLY_TELEMETRY=off REDOCLY_SUPPRESS_UPDATE_NOTICE=true
command -v npm >/dev/null || { echo "skipped: there is no npm"; exit 77; }
if [ ! node_modules/.installed -nt package-lock.json ]; then
  npm ci --no-progress || { echo "skipped: npm cannot install Redocly here"; exit 77; }
  touch node_modules/.installed
fi
exec ./node_modules/.bin/redocly lint "$document" --config redocly.yaml
