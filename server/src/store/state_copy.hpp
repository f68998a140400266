#pragma once

#include "store/database.hpp"
#include "store/disk_calls.hpp"

#include <filesystem>

namespace stillmap::server {

class PostgresAddress;

/// Copies all rows of a state, as of one instant, into one that has the same tables and nothing in
/// them, in one transaction. Ids go on from the last one that was given.
/// @throws InputError when there is something in the other one already; StorageError.
void copy_state(Database& from, Database& to);

/// Moves the state of a store from its folder to PostgreSQL, into a database with nothing of this
/// program in it, and attaches the folder. What was there is kept as `kMovedStateName`. Killed at
/// any time, it can be asked for again, with a database that has nothing in it.
/// @throws InputError also while a server has the store open; StateAway, StorageError.
void move_state(const std::filesystem::path& store, const PostgresAddress& to,
                DiskCalls& calls = DiskCalls::real());

}  // namespace stillmap::server
