#include "store/signature_table.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "store/database.hpp"
#include "store/store_database.hpp"

namespace stillmap::server {
namespace {

std::vector<MapSignature> signatures_of(Database& database, std::string_view map,
                                        std::string_view digest) {
  Statement row(database,
                "SELECT key, signature FROM signatures WHERE map = ? AND package = ? ORDER BY key");
  row.bind(map).bind(digest);
  std::vector<MapSignature> signatures;
  while (row.step()) signatures.push_back({row.text(0), row.text(1)});
  return signatures;
}

}  // namespace

std::vector<MapSignature> SignatureTable::of(std::string_view map, std::string_view digest) const {
  const StoreDatabase::Reading reading(*database_);
  return signatures_of(reading.database(), map, digest);
}

std::map<std::pair<std::string, std::string>, std::vector<MapSignature>> SignatureTable::all()
    const {
  const StoreDatabase::Reading reading(*database_);
  Statement row(reading.database(), "SELECT map, package, key, signature FROM signatures");
  std::map<std::pair<std::string, std::string>, std::vector<MapSignature>> all;
  while (row.step()) all[std::pair(row.text(0), row.text(1))].push_back({row.text(2), row.text(3)});
  return all;
}

void SignatureTable::add(std::string_view map, std::string_view digest,
                         const std::vector<MapSignature>& signatures) {
  // A mirror says the same again and again.
  const std::vector<MapSignature> known = of(map, digest);
  const auto is_known = [&](const MapSignature& each) {
    return std::find(known.begin(), known.end(), each) != known.end();
  };
  if (std::all_of(signatures.begin(), signatures.end(), is_known)) return;
  for (const MapSignature& each : signatures)
    if (!is_signature_of(each, map, digest))
      throw std::invalid_argument("signature by " + each.key + ": not of map '" + std::string(map) +
                                  "' and package " + std::string(digest) +
                                  "; sign this package for this map");
  StoreDatabase::Writing writing(*database_);
  Database& database = writing.database();
  for (const MapSignature& each : signatures)
    Statement(database,
              "INSERT INTO signatures (map, package, key, signature) VALUES (?, ?, ?, ?)"
              " ON CONFLICT (map, package, key) DO UPDATE SET signature = excluded.signature")
        .bind(map)
        .bind(digest)
        .bind(each.key)
        .bind(each.signature)
        .step();
  if (signatures_of(database, map, digest).size() > kMostSignatures)
    throw std::invalid_argument("signatures: more than " + std::to_string(kMostSignatures) +
                                "; a version has no room for another key");
  writing.commit();
}

}  // namespace stillmap::server
