#pragma once

#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "signing/map_signature.hpp"

namespace stillmap::server {

class StoreDatabase;

/// Signatures of the versions of a store, by map and package. Safe from several threads. Throws
/// StorageError when the disk fails.
class SignatureTable {
 public:
  /// By key. @param digest  of the package.
  [[nodiscard]] std::vector<MapSignature> of(std::string_view map, std::string_view digest) const;
  /// Of all versions, by map and digest.
  [[nodiscard]] std::map<std::pair<std::string, std::string>, std::vector<MapSignature>> all()
      const;
  /// Adds them, each in place of that by the same key. All or none.
  /// @throws std::invalid_argument for one that is not good, or when there would be more than
  /// `kMostSignatures`.
  void add(std::string_view map, std::string_view digest,
           const std::vector<MapSignature>& signatures);

 private:
  friend class StoreState;
  explicit SignatureTable(StoreDatabase& database) : database_(&database) {}
  StoreDatabase* database_;
};

}  // namespace stillmap::server
