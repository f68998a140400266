#include "mirror/map_mirror.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/package_delta.hpp>
#include <stillmap/maps/package_files.hpp>
#include <stillmap/maps/package_part.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>

#include "store/map_name.hpp"
#include "store/store_folder.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr const char* kMirrorName = "mirror";
/// Manifest of the map that a part is cut from.
constexpr const char* kWholeName = "whole.json";
constexpr std::size_t kMostName = 63;
/// The manifest of the largest map has some megabytes.
constexpr std::uint64_t kMostManifest = std::uint64_t{256} << 20U;

struct Stopped {};

/// Waits so that the mean rate stays below a limit.
class Pace {
 public:
  explicit Pace(std::optional<std::uint64_t> bytes_a_second) : limit_(bytes_a_second) {}

  void wait(std::uint64_t bytes) {
    sent_ += bytes;
    if (!limit_) return;
    const std::chrono::duration<double> due(static_cast<double>(sent_) /
                                            static_cast<double>(*limit_));
    std::this_thread::sleep_until(began_ + std::chrono::duration_cast<Clock::duration>(due));
  }

 private:
  std::optional<std::uint64_t> limit_;
  std::uint64_t sent_ = 0;
  Clock::time_point began_ = Clock::now();
};

class Mirror {
 public:
  Mirror(PackageStore& store, MirrorSource& source, const MirrorOptions& options,
         const MirrorProgress& progress, const std::atomic<bool>& cancel)
      : store_(store),
        source_(source),
        options_(options),
        progress_(progress),
        cancel_(cancel),
        active_(source.active(options.map)),
        folder_(store.folder() / kMirrorName / active_.digest),
        pace_(options.bytes_a_second) {
    if (!is_digest(active_.digest))
      throw MirrorSourceError("digest '" + active_.digest + "', expected 64 digits of 0-9 and a-f");
    result_.version = active_.version;
    result_.digest = active_.digest;
  }

  MirrorResult run() {
    const auto signatures = source_.signatures(options_.map, active_.version);
    refuse_untrusted(signatures);
    if (is_current()) {
      store_.signatures().add(options_.map, active_.digest, signatures);
      return result_;
    }
    clear_others();
    maps::MapManifest manifest = fetched_manifest();
    if (options_.around) {
      if (!cut(manifest)) return result_;
    }
    refuse_too_large(manifest);
    try {
      publish(manifest, base());
    } catch (const maps::InputError&) {
      // A file of the version before may be damaged on this disk: then all of it is fetched.
      if (!base()) throw;
      publish(manifest, std::nullopt);
    }
    // They are of the whole.
    if (!options_.around) store_.signatures().add(options_.map, active_.digest, signatures);
    store_.activate(options_.map, name_);
    fs::remove_all(store_.folder() / kMirrorName);
    (void)store_.keep_newest(options_.map, 0);
    result_.is_new = true;
    return result_;
  }

 private:
  [[nodiscard]] std::optional<StoredMap> stored() const {
    for (const StoredMap& map : store_.state().maps())
      if (map.name == options_.map) return map;
    return std::nullopt;
  }
  [[nodiscard]] bool is_current() const {
    const auto map = stored();
    return map && !options_.around && map->active == active_.version &&
           store_.state().version(options_.map, active_.version).digest == active_.digest;
  }
  /// The version that the store has, whose files need not be fetched.
  [[nodiscard]] std::optional<std::string> base() const {
    const auto map = stored();
    if (!map || !map->active) return std::nullopt;
    return store_.state().version(options_.map, *map->active).digest;
  }

  /// What was begun of versions that are not served any more.
  void clear_others() const {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder_.parent_path(), error))
      if (entry.path() != folder_) fs::remove_all(entry.path(), error);
    fs::create_directories(folder_, error);
    if (error) throw maps::StorageError(folder_.string(), error.message());
  }

  maps::MapManifest fetched_manifest() {
    const fs::path file = folder_ / (options_.around ? kWholeName : maps::kManifestName);
    fetch(file, {kMostManifest, active_.digest}, /*size_is_known=*/false);
    return maps::parse_manifest(maps::read_text(file), file.string());
  }

  /// Makes the manifest that of the part which was asked for, and writes it.
  /// @return false when this part is the active version.
  bool cut(maps::MapManifest& manifest) {
    const MirrorOptions::Around& around = *options_.around;
    const maps::PackagePart part{
        active_.digest, maps::regions_around(manifest, around.place_map_m, around.radius_m)};
    result_.regions = part.regions.size();
    if (part.regions.empty())
      throw maps::InputError(options_.map + "/" + active_.version,
                             fmt::format("nothing within {:g} m of {:g}, {:g}", around.radius_m,
                                         around.place_map_m.x(), around.place_map_m.y()),
                             "a place in the map: coordinates are those of the map frame");
    if (const auto active = base();
        active &&
        maps::part_in(maps::MapPackage::open(store_.local(*active).folder)->manifest()) == part)
      return false;
    for (const auto& [path, file] : maps::files_but_packs(manifest, part.regions))
      if (path.ends_with(".node")) fetch(folder_ / path, file, /*size_is_known=*/true);
    manifest = maps::manifest_of_part(manifest, part, folder_);
    const std::string text = maps::manifest_text(manifest);
    std::ofstream(folder_ / maps::kManifestName, std::ios::binary) << text << std::flush;
    const std::string suffix = ".part-" + maps::sha256_of(text).substr(0, 8);
    name_ = active_.version.substr(0, kMostName - suffix.size()) + suffix;
    return true;
  }

  void refuse_untrusted(const std::vector<MapSignature>& signatures) const {
    if (!options_.trusted ||
        is_signed_by(*options_.trusted, signatures, options_.map, active_.digest))
      return;
    throw maps::InputError(
        options_.map + "/" + active_.version,
        fmt::format("{} signatures, none by a trusted key", signatures.size()),
        "one: sign it with `stillmap keys sign`, or give the public key of who signed it; the "
        "version before stays active");
  }

  void refuse_too_large(const maps::MapManifest& manifest) {
    for (const auto& [path, file] : manifest.files) result_.bytes += file.bytes;
    if (!options_.most_bytes || result_.bytes <= *options_.most_bytes) return;
    throw maps::InputError(
        options_.map + "/" + active_.version, fmt::format("{} bytes", result_.bytes),
        fmt::format("at most {}: make room and allow more", *options_.most_bytes));
  }

  /// Fetches what is missing beside a version that is there, and publishes it.
  void publish(const maps::MapManifest& manifest, const std::optional<std::string>& beside) {
    std::optional<fs::path> other;
    PackageBlobs::Local local;
    auto missing = manifest.files;
    if (beside) {
      local = store_.local(*beside);
      other = local.folder;
      missing = maps::package_delta(maps::MapPackage::open(*other)->manifest(), manifest).missing;
    }
    total_ = done_ = 0;
    for (const auto& [path, file] : missing) total_ += file.bytes;
    for (const auto& [path, file] : missing) {
      fetch(folder_ / path, file, /*size_is_known=*/true);
      done_ += file.bytes;
      tell(0);
    }
    PackageArchive archive(folder_, other);
    std::uint64_t at = 0;
    const ByteSource source = [&](std::span<char> to) {
      const std::size_t got = archive.read(at, to);
      at += got;
      return got;
    };
    (void)store_.add_archive(options_.map, name_, {source, options_.map + "/" + name_});
  }

  void tell(std::uint64_t of_file) const {
    if (progress_) progress_(done_ + of_file, total_);
  }

  /// Puts a file to its place; what is there of it already is not fetched again.
  void fetch(const fs::path& file, const maps::MapManifest::File& listed, bool size_is_known) {
    if (fs::exists(file) && maps::sha256_of_file(file) == listed.sha256) return;
    std::error_code error;
    fs::create_directories(file.parent_path(), error);
    if (error) throw maps::StorageError(file.parent_path().string(), error.message());
    const fs::path part = file.string() + ".part";
    const std::uint64_t there = fs::exists(part) ? fs::file_size(part) : 0;
    if (there > 0 && size_is_known && there < listed.bytes) {
      read(part, listed, there);
      if (take_if_whole(part, file, listed.sha256)) return;
    }
    // From the beginning: nothing was there, or something else.
    fs::remove(part);
    read(part, listed, 0);
    if (take_if_whole(part, file, listed.sha256)) return;
    fs::remove(part);
    throw maps::InputError(
        options_.map + "/" + active_.version + ": " + file.filename().string(),
        "other bytes than those of SHA-256 " + listed.sha256,
        "these: somebody changes them on their way, or the server is another one; nothing was "
        "kept; look at the connection and try again");
  }

  static bool take_if_whole(const fs::path& part, const fs::path& file, const std::string& sha256) {
    if (maps::sha256_of_file(part) != sha256) return false;
    fs::rename(part, file);
    return true;
  }

  /// Appends what comes from an offset on.
  void read(const fs::path& part, const maps::MapManifest::File& listed, std::uint64_t offset) {
    std::ofstream out(part, std::ios::binary | std::ios::app);
    std::uint64_t have = offset;
    bool too_long = false;
    source_.read({options_.map, active_.version, listed.sha256}, offset,
                 [&](std::string_view piece) {
                   if (cancel_) return false;
                   have += piece.size();
                   too_long = have > listed.bytes;
                   if (too_long) return false;
                   out.write(piece.data(), static_cast<std::streamsize>(piece.size()));
                   // So that what has come is there for the next call.
                   out.flush();
                   result_.bytes_fetched += piece.size();
                   tell(have);
                   pace_.wait(piece.size());
                   return static_cast<bool>(out);
                 });
    if (cancel_) throw Stopped();
    if (!out) throw maps::StorageError(part.string(), "cannot be written: look at the disk's room");
  }

  PackageStore& store_;
  MirrorSource& source_;
  const MirrorOptions& options_;
  const MirrorProgress& progress_;
  const std::atomic<bool>& cancel_;
  MirrorSource::Active active_;
  /// Of the version here.
  std::string name_ = active_.version;
  fs::path folder_;
  Pace pace_;
  MirrorResult result_;
  std::uint64_t done_ = 0, total_ = 0;
};

}  // namespace

std::optional<MirrorResult> mirror_map(PackageStore& store, MirrorSource& source,
                                       const MirrorOptions& options, const MirrorProgress& progress,
                                       const std::atomic<bool>& cancel) {
  if (!is_valid_map_name(options.map))
    throw std::invalid_argument("map: '" + options.map + "', [a-z0-9][a-z0-9._-]{0,62} expected");
  try {
    return Mirror(store, source, options, progress, cancel).run();
  } catch (const Stopped&) {
    return std::nullopt;
  }
}

}  // namespace stillmap::server
