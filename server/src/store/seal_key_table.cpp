#include "store/seal_key_table.hpp"

#include <algorithm>

#include "store/database.hpp"
#include "store/store_database.hpp"

namespace stillmap::server {
namespace {

using Rows = std::vector<SealKeyTable::Row>;

Rows newest_of(Database& database) {
  Statement row(database, "SELECT secret, made_ns FROM seal_keys ORDER BY made_ns DESC LIMIT 2");
  Rows rows;
  while (row.step()) rows.push_back({row.text(0), row.integer(1)});
  return rows;
}

void put(StoreDatabase::Writing& writing, const SealKeyTable::Row& row, const Rows& before) {
  Database& database = writing.database();
  // Clocks of servers differ.
  const std::int64_t made_ns =
      before.empty() ? row.made_ns : std::max(row.made_ns, before.front().made_ns + 1);
  Statement(database, "DELETE FROM seal_keys WHERE made_ns < ?")
      .bind(before.empty() ? made_ns : before.front().made_ns)
      .step();
  Statement(database, "INSERT INTO seal_keys (made_ns, secret) VALUES (?, ?)")
      .bind(made_ns)
      .bind(row.secret)
      .step();
  writing.commit();
}

}  // namespace

Rows SealKeyTable::newest() const {
  const StoreDatabase::ReadingBeside reading(*database_);
  return newest_of(reading.database());
}

void SealKeyTable::add(const Row& row) {
  StoreDatabase::Writing writing(*database_);
  put(writing, row, newest_of(writing.database()));
}

void SealKeyTable::add_first(const Row& row) {
  StoreDatabase::Writing writing(*database_);
  const Rows before = newest_of(writing.database());
  if (before.empty()) put(writing, row, before);
}

}  // namespace stillmap::server
