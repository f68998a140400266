#pragma once

#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/map_package.hpp>

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace stillmap::maps {

class TileFile;

/// Which of two versions a point is only in.
enum class DifferenceSide : std::uint8_t { kVersion = 0, kOther = 1 };

/// Points that only one of two versions of a map has.
struct DifferenceCounts {
  std::uint64_t points = 0;
  /// By `PointKind`.
  std::array<std::uint64_t, 4> kinds{};
  /// Ground squares of 1 m x 1 m that hold such a point [m^2].
  std::uint64_t area_m2 = 0;
  /// Points measured above the ground where drives of the other version saw free space: they are
  /// gone, or new. At the others it may only not have looked.
  std::uint64_t seen_free = 0;
};
struct DifferenceTile {
  DifferenceSide side = DifferenceSide::kVersion;
  /// Of level 0; place and bounds relative to the origin of the first version, for both sides.
  TileEntry entry;
  DifferenceCounts counts;
};

/// What two versions of a map in one map frame differ in: the points of each without a point of the
/// other within a tolerance, whatever their kinds. Tiles are those of the first version's grid; the
/// points of the other are moved by the difference of the origins, where there is one.
///
/// It lies in the first version's folder `differences/`, outside its digest, beside those with
/// other versions and tolerances: `kKept` of them, and no more bytes than the points of both
/// versions take, or 1 MiB; the oldest go. Immutable, safe from several threads.
class MapDifference {
 public:
  static constexpr double kSmallestToleranceM = 0.01;
  static constexpr double kLargestToleranceM = 2.0;
  static constexpr std::size_t kKept = 8;

  /// 1.5 times the coarser voxel of the two, within the bounds: points of one surface seen twice
  /// lie closer.
  [[nodiscard]] static double usual_tolerance_m(const MapPackage& version, const MapPackage& other);
  /// To the millimetre.
  [[nodiscard]] static std::uint32_t tolerance_mm(double tolerance_m);

  /// Computes and writes it, tile by tile: memory is some 60 bytes for each point of nine tiles.
  /// @param tolerance_m  within the bounds above; told apart by the millimetre.
  /// @return where it lies.
  /// @throws std::invalid_argument for a tolerance out of bounds, StorageError, WorkStopped.
  static std::filesystem::path make(const MapPackage& version, const MapPackage& other,
                                    double tolerance_m, const DerivedWork& work = {});
  /// @throws StorageError when there is none or it cannot be read, InputError when it is damaged or
  /// of another format: `make` it.
  [[nodiscard]] static std::shared_ptr<const MapDifference> open(const MapPackage& version,
                                                                 const MapPackage& other,
                                                                 double tolerance_m);
  /// Removes the file, if there is one.
  static void remove(const MapPackage& version, const MapPackage& other, double tolerance_m);
  ~MapDifference();
  MapDifference(const MapDifference&) = delete;
  MapDifference& operator=(const MapDifference&) = delete;

  /// Those that hold a point, by side and place.
  [[nodiscard]] const std::vector<DifferenceTile>& tiles() const { return tiles_; }
  /// Null when there is none.
  [[nodiscard]] const DifferenceTile* find(DifferenceSide side, std::int32_t x,
                                           std::int32_t y) const;
  [[nodiscard]] DifferenceCounts total(DifferenceSide side) const;
  /// From the tile's corner. @param tile  one of `tiles()`.
  /// @throws InputError when they are damaged, StorageError.
  [[nodiscard]] std::vector<MapPoint> points(const DifferenceTile& tile) const;

 private:
  MapDifference();
  std::unique_ptr<const TileFile> file_;
  std::vector<DifferenceTile> tiles_;
};

}  // namespace stillmap::maps
