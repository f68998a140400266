#!/usr/bin/env bash
# Runs a PostgreSQL of its own in the foreground, for tests: postgres.sh FOLDER [SETTING...]; postgres.sh --check ends
# with 77 where there is none.
# Its socket is in FOLDER, and it listens on no address unless a setting says so. It ends with whoever started it. As root
# it runs as nobody, which PostgreSQL wants.
set -euo pipefail
folder=$1
shift
here=$(cd "$(dirname "$0")/../.." && pwd)
for bin in /usr/lib/postgresql/*/bin "$here"/build/deploy_tools/usr/lib/postgresql/*/bin; do
  [ ! -x "$bin/initdb" ] || break
done
[ -x "$bin/initdb" ] || { echo "postgres.sh: no PostgreSQL: install the package postgresql-15" >&2; exit 77; }
[ "$folder" != --check ] || exit 0
as=(env)
if [ "$(id -u)" -eq 0 ]; then
  chown nobody "$folder"
  as=(setpriv --reuid nobody --regid nogroup --clear-groups --pdeathsig SIGQUIT)
fi
if [ ! -e "$folder/data/PG_VERSION" ]; then
  "${as[@]}" "$bin/initdb" -D "$folder/data" -A trust -U postgres -E UTF8 --locale C --no-sync >"$folder/initdb.log"
fi
settings=(-c "unix_socket_directories=$folder" -c listen_addresses= -c fsync=off -c max_wal_size=256MB -c jit=off)
for setting in "$@"; do settings+=(-c "$setting"); done
exec "${as[@]}" "$bin/postgres" -D "$folder/data" "${settings[@]}"
