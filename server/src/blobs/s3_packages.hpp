#pragma once

#include "blobs/blob_cache.hpp"
#include "blobs/s3_client.hpp"
#include "store/package_blobs.hpp"
#include "store/package_folder.hpp"

#include <chrono>
#include <cstddef>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace stillmap::server {

struct S3PackagesOptions {
  S3Options s3{};
  BlobCacheOptions cache{};
  /// A blob that no package has is taken for one that is being sent for so long.
  std::chrono::seconds least_age{3600};
};

/// Packages in S3: each file once, as the object `blobs/SHA256`. On the local disk lie a cache of
/// these, and packages that are read, as folders of hard links to them. A package that is open is
/// locked by its reader; when the cache needs room, others are taken apart, the least recently used
/// first.
class S3Packages final : public PackageBlobs {
 public:
  /// @param calls, clock  outlive this. @throws std::invalid_argument for options; StorageError.
  explicit S3Packages(const S3PackagesOptions& options, DiskCalls& calls = DiskCalls::real(),
                      S3Client::Clock clock = &std::chrono::system_clock::now);

  [[nodiscard]] std::filesystem::path packages() const override { return packages_.path(); }
  [[nodiscard]] FolderLock locked() const override { return cache_.locked(); }
  [[nodiscard]] Local bring(const std::string& digest) override;
  [[nodiscard]] std::optional<Local> find_local(const std::string& digest) const override;
  bool drop_damaged(const std::string& digest) override;
  [[nodiscard]] maps::MapManifest manifest(const std::string& digest) override;
  [[nodiscard]] maps::MapManifest manifest_if_near(const std::string& digest) override;
  void bring_file(const maps::MapManifest::File& file, const std::filesystem::path& to) override;
  void send(const std::filesystem::path& package, const FileBytes& there, bool again) override;
  void confirm(const std::filesystem::path& package, const FileBytes& there) override;
  [[nodiscard]] std::string damage_of(const std::string& digest, Verified& known) override;
  void remove(const std::string& digest, const FileBytes& kept) override;
  [[nodiscard]] std::vector<std::string> unnamed(const FileBytes& named) override;
  void remove_blobs(const std::vector<std::string>& sha256s) override;
  [[nodiscard]] Figures figures() const override;
  void stop() override {
    client_.stop();
    hasty_client_.stop();
  }
  /// @throws maps::InputError when there are no credentials.
  void require_credentials() { client_.require_credentials(); }

 private:
  void make_local(const std::string& digest);
  /// Takes the least recently used package apart that nobody reads.
  [[nodiscard]] bool release_one() const;
  void put_missing(const std::filesystem::path& package, const FileBytes& there, bool again,
                   bool is_first_time);
  [[nodiscard]] std::string wrong_with(const std::string& sha256, std::uint64_t bytes);

  S3PackagesOptions options_;
  DurableFiles files_;
  S3Client client_;
  /// Tries once, and not for long.
  S3Client hasty_client_;
  BlobCache cache_;
  PackageFolder packages_;
  S3Client::Clock clock_;
  std::mutex mutex_;
  std::condition_variable made_;
  /// That a thread of this process brings just now.
  std::set<std::string> coming_;
  /// Of `hasty_client_`.
  std::optional<S3Error> away_because_;
  std::chrono::steady_clock::time_point away_until_{};
};

}  // namespace stillmap::server
