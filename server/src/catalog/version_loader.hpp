#pragma once

#include "catalog/served_version.hpp"
#include "metrics/metrics.hpp"
#include "store/package_store.hpp"

#include <stillmap/maps/error.hpp>

#include <cstdint>
#include <exception>
#include <filesystem>
#include <memory>
#include <string>

namespace stillmap::server {

/// Makes one version usable: opens its package, which is fetched first if it lies elsewhere, and
/// makes its aligners. Which versions are served is not its business. Safe from several threads.
class VersionLoader {
 public:
  /// @param store  outlives this. @param metrics  counts loads when there; outlives this.
  /// @param options_folder  of `localization_options_of`; empty where all maps have the defaults.
  VersionLoader(const PackageStore& store, AlignerBuilder builder, Metrics* metrics,
                std::filesystem::path options_folder);

  enum class Fetch : std::uint8_t { kNo, kYes };
  /// A version whose package cannot be opened has failed. One whose package would have to be
  /// fetched, and must not be, is loading and has none. What is damaged in the cache is fetched
  /// again, once.
  /// @throws StoreRefusal when the store knows no such version; StateAway.
  [[nodiscard]] ServedVersion opened(const std::string& map, const std::string& version,
                                     Fetch fetch) const;
  /// With its aligners, or failed. One that was damaged in the cache is loading and has no package:
  /// it must be opened again. @param version  has a package.
  void make_ready(ServedVersion& version) const;
  /// As clients are told, health without a key too: places of this machine stay in the log.
  [[nodiscard]] std::string shown(const std::exception& error) const;

 private:
  [[nodiscard]] std::shared_ptr<const maps::MapPackage> fetched(const ServedVersion& version) const;
  [[nodiscard]] bool drop_damaged(const ServedVersion& version,
                                  const maps::InputError& error) const;
  void fail(ServedVersion& version, const std::exception& error, const char* what) const;
  const PackageStore& store_;
  AlignerBuilder builder_;
  Metrics* metrics_;
  std::filesystem::path options_folder_;
};

/// "version 'V' of map 'M'"
[[nodiscard]] std::string version_text(const std::string& map, const std::string& version);

}  // namespace stillmap::server
