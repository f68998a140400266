#pragma once

#include <stillmap/maps/scan.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

namespace stillmap::maps {

/// Kinds of bytes that hold one scan.
enum class ScanFormat {
  kBinXyzi,   ///< little-endian float32 x y z intensity (KITTI)
  kBinXyz,    ///< little-endian float32 x y z
  kBinXyzit,  ///< little-endian float32 x y z intensity time [s], relative to the scan's stamp
  kPcd,       ///< PCD 0.5 to 0.7: ascii, binary, binary_compressed; any field order and type
  kPly,       ///< PLY 1.0: ascii, binary little and big endian
};

/// Bytes of a point of the three kinds without a header. @throws std::invalid_argument for others.
[[nodiscard]] std::size_t raw_point_bytes(ScanFormat format);

/// Points, drops and count as in `Scan`.
struct DecodedScan {
  PointCloud cloud;
  DropCounts dropped;
  std::size_t points_in_file = 0;
  /// What people should know of the times of the points: how the column was read where that is not
  /// plain, or why it was left out. Empty otherwise.
  std::string times_note;
};

/// Which columns of PCD and PLY are read: x y z; one of intensity, i, reflectivity, reflectance,
/// scalar_intensity (the first that is there; not finite = 0); and a time when exactly one of t,
/// time, timestamp, offset_time, time_stamp, time_offset_ns, point_time_offset, relative_timestamp
/// is there. Names in any case. Times are read in the unit
/// in which a sweep takes as long as sensors need for one, from the stamp or from a clock's zero
/// (`formats/point_times.hpp`); where there is none, all are left out, and `times_note` says why.
/// In `kBinXyzit` they are seconds from the stamp; others are refused.
///
/// Decodes bytes from anywhere, also hostile ones: memory stays below the decoded points plus the
/// input, and never more than `max_points` are decoded.
/// @param name      for messages only.
/// @param stamp_ns  of the scan since the epoch, where it is known: points may have times of it.
/// @throws InputError naming `name`, the value found and what was expected.
[[nodiscard]] DecodedScan decode_scan(std::span<const std::byte> bytes, ScanFormat format,
                                      const std::string& name, std::size_t max_points = 20'000'000,
                                      std::optional<std::int64_t> stamp_ns = std::nullopt);

/// What a file of a scan does not tell by itself.
struct ScanFileHints {
  /// Since the epoch, where it is known.
  std::optional<std::int64_t> stamp_ns;
  /// Columns of a .bin of float32, a letter each: x, y, z, i (intensity), t (time [s] from the
  /// stamp), and r (ring) or _ for what is left out.
  std::string bin_columns = "xyzi";
};

/// @throws InputError for text that is none: x, y and z once each, i and t at most once, at most 32
/// letters.
void require_bin_columns(const std::string& columns);

/// Reads a file whose format follows from its extension (.bin .pcd .ply).
/// @throws InputError as above or for an unknown extension; StorageError when it cannot be read.
[[nodiscard]] DecodedScan read_scan_file(const std::filesystem::path& file,
                                         const ScanFileHints& hints = {});

}  // namespace stillmap::maps
