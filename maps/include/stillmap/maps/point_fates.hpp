#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <vector>

namespace stillmap::maps {

/// What a build did with a point of a scan.
enum class PointFate : std::uint8_t {
  kKept = 0,       ///< into the map as it was measured
  kGround = 1,     ///< the same, as ground
  kProjected = 2,  ///< of an object, into the map on the ground below
  kDeleted = 3,    ///< not in the map: of an object, or where nothing can be (no object)
  kDropped = 4,    ///< unusable, out of range or the vehicle itself
};
inline constexpr std::uint8_t kPointFates = 5;

/// Of the points of one scan, in the order of its file.
struct ScanFates {
  std::vector<PointFate> fates;
  /// As many: index into objects.json plus 1 for points of an object, else 0.
  std::vector<std::uint32_t> objects;

  [[nodiscard]] std::size_t size() const { return fates.size(); }
  void resize(std::size_t points) {
    fates.assign(points, PointFate::kDropped);
    objects.assign(points, 0);
  }
  bool operator==(const ScanFates&) const = default;
};

/// Writes `fates.bin`: runs of equal points, scan by scan, then where each scan begins.
class FatesWriter {
 public:
  /// @throws StorageError, as do all members.
  explicit FatesWriter(std::filesystem::path file);
  /// @throws std::invalid_argument when the two lists differ in length.
  void add(const ScanFates& fates);
  /// Once, at the end.
  void finish();

 private:
  struct Close {
    void operator()(std::FILE* stream) const { std::fclose(stream); }
  };
  void write(const void* bytes, std::size_t count);

  std::filesystem::path file_;
  std::unique_ptr<std::FILE, Close> stream_;
  std::uint64_t position_ = 0;
  std::vector<std::uint64_t> begins_;
};

/// @param scan  ordinal. @throws InputError for a broken file or an ordinal beyond it,
/// StorageError.
[[nodiscard]] ScanFates read_fates(const std::filesystem::path& file, std::size_t scan);

}  // namespace stillmap::maps
