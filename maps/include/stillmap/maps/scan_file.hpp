#pragma once

#include <stillmap/maps/scan.hpp>

#include <cstddef>
#include <filesystem>
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
};

/// Which columns of PCD and PLY are read: x y z; one of intensity, i, reflectivity, reflectance,
/// scalar_intensity (the first that is there; not finite = 0); and a time when exactly one of t,
/// time, timestamp, offset_time, time_stamp is there: seconds in floating types, nanoseconds in
/// whole ones, relative to the scan's stamp. Times beyond 1 s of it (epochs, microseconds) have
/// another zero or unit, and then all of them are left out; in `kBinXyzit` they are refused. Names
/// in any case.
///
/// Decodes bytes from anywhere, also hostile ones: memory stays below the decoded points plus the
/// input, and never more than `max_points` are decoded.
/// @param name  for messages only.
/// @throws InputError naming `name`, the value found and what was expected.
[[nodiscard]] DecodedScan decode_scan(std::span<const std::byte> bytes, ScanFormat format,
                                      const std::string& name, std::size_t max_points = 20'000'000);

/// Reads a file whose format follows from its extension (.bin .pcd .ply).
/// @throws InputError as above or for an unknown extension; StorageError when it cannot be read.
[[nodiscard]] DecodedScan read_scan_file(const std::filesystem::path& file);

}  // namespace stillmap::maps
