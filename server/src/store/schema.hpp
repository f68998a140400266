#pragma once

#include "store/postgres_database.hpp"
#include "store/sqlite_database.hpp"

namespace stillmap::server {

/// Version that this program writes.
[[nodiscard]] int schema_version();

/// Makes the tables, or brings those of an older program up to date, one transaction a step.
/// @throws InputError for a database that is not a store's or is of a newer program.
void migrate(SqliteDatabase& database);
/// @throws also StateAway.
void migrate(PostgresDatabase& database);

}  // namespace stillmap::server
