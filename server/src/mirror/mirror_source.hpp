#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "signing/map_signature.hpp"

namespace stillmap::server {

/// What a server answered, or that it did not.
struct MirrorSourceError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Where a mirror gets versions from.
class MirrorSource {
 public:
  virtual ~MirrorSource() = default;

  /// The version of a map that is served.
  struct Active {
    std::string version, digest;
  };
  /// @throws MirrorSourceError, also for a map without a version that is served.
  [[nodiscard]] virtual Active active(const std::string& map) = 0;

  /// Those of a version. @throws MirrorSourceError; maps::InputError for what is none.
  [[nodiscard]] virtual std::vector<MapSignature> signatures(const std::string& map,
                                                             const std::string& version) = 0;

  /// A file of a version.
  struct File {
    std::string map, version, sha256;
  };
  /// Takes pieces of a file; false ends it.
  using Take = std::function<bool(std::string_view)>;
  /// Gives the bytes of a file from an offset on, in pieces. @throws MirrorSourceError.
  virtual void read(const File& file, std::uint64_t offset, const Take& take) = 0;
};

/// A server of ours. @param url  such as http://HOST:8080. @param key  empty: none is sent.
/// @param vehicle  label for which the version is asked; empty: none is told.
/// @throws std::invalid_argument for another URL.
[[nodiscard]] std::unique_ptr<MirrorSource> http_source(const std::string& url,
                                                        const std::string& key,
                                                        const std::string& vehicle = {});

}  // namespace stillmap::server
