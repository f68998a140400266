#pragma once

#include <fcntl.h>
#include <openssl/evp.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>

#include "stillmap_client.hpp"

/// A copy of a map on this disk, for C++17: over stillmap_client.hpp and OpenSSL (-lcrypto).
namespace stillmap::client {

struct Mirrored {
  MapReference map;
  /// Folder of the map package.
  std::filesystem::path package;
  /// Whether it came now.
  bool is_new = false;
  std::uint64_t fetched_bytes = 0;
};

namespace detail {

/// Of a file's bytes, hex; empty when it cannot be read.
inline std::string sha256_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> hash(EVP_MD_CTX_new(),
                                                                     EVP_MD_CTX_free);
  if (!in || !hash || EVP_DigestInit_ex(hash.get(), EVP_sha256(), nullptr) != 1) return {};
  std::array<char, std::size_t{1} << 16U> block{};
  while (in.read(block.data(), block.size()) || in.gcount() > 0)
    EVP_DigestUpdate(hash.get(), block.data(), static_cast<std::size_t>(in.gcount()));
  std::array<unsigned char, EVP_MAX_MD_SIZE> bytes{};
  unsigned size = 0;
  EVP_DigestFinal_ex(hash.get(), bytes.data(), &size);
  std::string hex;
  for (unsigned i = 0; i < size; ++i) {
    std::array<char, 3> digits{};
    std::snprintf(digits.data(), digits.size(), "%02x", bytes[i]);
    hex += digits.data();
  }
  return hex;
}

/// A path of a manifest, which nothing may lead out of the package.
inline std::filesystem::path checked_path(const std::string& text) {
  const std::filesystem::path path(text);
  const bool leads_out = std::find(path.begin(), path.end(), "..") != path.end();
  if (text.empty() || path.is_absolute() || leads_out)
    throw Error("manifest.json: found the path '" + text +
                "', expected one in the package: this is no map package");
  return path;
}

/// Makes a file, or the names in a folder, last.
inline void sync(const std::filesystem::path& path) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool is_synced = descriptor >= 0 && ::fsync(descriptor) == 0;
  if (descriptor >= 0) ::close(descriptor);
  if (!is_synced) throw Error(path.string() + ": cannot be synced: look at the disk");
}

/// Fetches one version into a folder beside others.
class VersionFetch {
 public:
  VersionFetch(Client& client, MapReference map, const std::filesystem::path& folder)
      : client_(client), map_(std::move(map)), incoming_(folder / (map_.digest + ".incoming")) {}

  /// @param before  package whose files need not be fetched. @return bytes that were fetched.
  std::uint64_t run(const std::filesystem::path& before) {
    std::filesystem::create_directories(incoming_);
    take(map_.digest, incoming_ / "manifest.json");
    std::map<std::string, std::filesystem::path> known;
    for (const auto& [path, sha256] : files_in(before)) known.emplace(sha256, before / path);
    const auto wanted = files_in(incoming_);
    if (wanted.empty())
      throw Error(map_.digest + ": found a manifest without files: this is no map package");
    for (const auto& [path, sha256] : wanted) {
      const std::filesystem::path target = incoming_ / path;
      std::filesystem::create_directories(target.parent_path());
      const auto old = known.find(sha256);
      // What lies there may be damaged.
      if (old != known.end() && !std::filesystem::exists(target) &&
          sha256_of(old->second) == sha256) {
        std::error_code error;
        std::filesystem::create_hard_link(old->second, target, error);
      }
      take(sha256, target);
    }
    // What has a package's name is whole, also after a power cut.
    for (const auto& entry : std::filesystem::recursive_directory_iterator(incoming_))
      sync(entry.path());
    sync(incoming_);
    std::filesystem::rename(incoming_, incoming_.parent_path() / map_.digest);
    sync(incoming_.parent_path());
    return fetched_;
  }

 private:
  void take(const std::string& sha256, const std::filesystem::path& target) {
    if (sha256_of(target) == sha256) return;
    std::filesystem::remove(target);
    fetched_ += client_.download_file(map_, sha256, target.string());
    if (sha256_of(target) == sha256) return;
    std::filesystem::remove(target);
    throw Error(target.string() + ": found other bytes than those of SHA-256 " + sha256 +
                "; nothing of them was kept: look at the connection and try again");
  }
  /// Paths and checksums; none for a folder that is no package.
  static std::map<std::filesystem::path, std::string> files_in(
      const std::filesystem::path& package) {
    std::map<std::filesystem::path, std::string> files;
    std::ifstream in(package / "manifest.json");
    const auto json = nlohmann::json::parse(in, nullptr, /*allow_exceptions=*/false);
    if (!json.is_object() || !json.contains("files")) return files;
    for (const auto& [path, file] : json["files"].items())
      if (file.is_object() && file.contains("sha256") && file["sha256"].is_string())
        files.emplace(checked_path(path), file["sha256"].get<std::string>());
    return files;
  }

  Client& client_;
  MapReference map_;
  std::filesystem::path incoming_;
  std::uint64_t fetched_ = 0;
};

}  // namespace detail

/// Keeps a copy of the version that a server serves as FOLDER/current, a map package that other
/// programs may read meanwhile. Fetches only files that the copy before does not have; each is
/// compared with its SHA-256. Call it again after an interruption, or to follow the server. The
/// version before stays too. No signature is checked: for that there is `stillmap mirror
/// --trusted`.
/// @param vehicle  as in `Client::active`.
/// @throws Problem, ConnectionLost; Error for bytes that are not what the version's digest says.
inline Mirrored mirror(Client& client, const std::string& map, const std::filesystem::path& folder,
                       const std::string& vehicle = {}) {
  namespace fs = std::filesystem;
  Mirrored mirrored{client.active(map, vehicle), {}, false, 0};
  const std::string& digest = mirrored.map.digest;
  fs::create_directories(folder);
  mirrored.package = folder / digest;
  mirrored.is_new = !fs::is_directory(mirrored.package);
  if (mirrored.is_new)
    mirrored.fetched_bytes =
        detail::VersionFetch(client, mirrored.map, folder).run(folder / "current");
  std::error_code none;
  const fs::path before = fs::read_symlink(folder / "current", none);
  if (before == digest) return mirrored;
  fs::remove(folder / "current.new");
  fs::create_directory_symlink(digest, folder / "current.new");
  fs::rename(folder / "current.new", folder / "current");
  detail::sync(folder);
  for (const auto& entry : fs::directory_iterator(folder))
    if (!entry.is_symlink() && entry.is_directory() && entry.path().filename() != digest &&
        entry.path().filename() != before)
      fs::remove_all(entry.path());
  return mirrored;
}

}  // namespace stillmap::client
