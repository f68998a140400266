#include <stillmap/maps/error.hpp>
#include <stillmap/maps/scan_file.hpp>
#include <stillmap/maps/scan_limit.hpp>

#include <cstdint>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "formats/bin.hpp"
#include "formats/file_bytes.hpp"
#include "formats/pcd.hpp"
#include "formats/ply.hpp"

namespace stillmap::maps {
namespace {

/// What is larger is a map (`cloud_file.hpp`): it would be read into memory as a whole.
constexpr std::uintmax_t kMostFileBytes = std::uintmax_t{1} << 30U;
thread_local std::size_t most_scan_points = 20'000'000;

ScanFormat format_of(const std::filesystem::path& file) {
  const std::string extension = file.extension().string();
  if (extension == ".bin") return ScanFormat::kBinXyzi;
  if (extension == ".pcd") return ScanFormat::kPcd;
  if (extension == ".ply") return ScanFormat::kPly;
  throw InputError(file.string(), "extension '" + extension + "'",
                   ".bin, .pcd or .ply: convert the scan");
}

}  // namespace

ScanLimit::ScanLimit(std::size_t max_points)
    : before_(std::exchange(most_scan_points, max_points)) {}

ScanLimit::~ScanLimit() { most_scan_points = before_; }

std::size_t raw_point_bytes(ScanFormat format) {
  switch (format) {
    case ScanFormat::kBinXyz:
      return 3 * sizeof(float);
    case ScanFormat::kBinXyzi:
      return 4 * sizeof(float);
    case ScanFormat::kBinXyzit:
      return 5 * sizeof(float);
    case ScanFormat::kPcd:
    case ScanFormat::kPly:
      break;
  }
  throw std::invalid_argument("raw_point_bytes: a format with a header");
}

DecodedScan decode_scan(std::span<const std::byte> bytes, ScanFormat format,
                        const std::string& name, std::size_t max_points,
                        std::optional<std::int64_t> stamp_ns) {
  switch (format) {
    case ScanFormat::kBinXyzi:
      return decode_bin(bytes, "xyzi", name, max_points);
    case ScanFormat::kBinXyz:
      return decode_bin(bytes, "xyz", name, max_points);
    case ScanFormat::kBinXyzit:
      return decode_bin(bytes, "xyzit", name, max_points);
    case ScanFormat::kPcd:
      return decode_pcd(bytes, name, max_points, stamp_ns);
    case ScanFormat::kPly:
      return decode_ply(bytes, name, max_points, stamp_ns);
  }
  throw std::invalid_argument("decode_scan: unknown format");
}

DecodedScan read_scan_file(const std::filesystem::path& file, const ScanFileHints& hints) {
  const ScanFormat format = format_of(file);
  std::error_code ignored;
  // What is not there is told of where it is opened.
  const std::uintmax_t size = std::filesystem::file_size(file, ignored);
  if (!ignored && size > kMostFileBytes)
    throw InputError(
        file.string(), std::to_string(size) + " bytes of one scan",
        "at most " + std::to_string(kMostFileBytes) + "; a whole map is read by `stillmap import`");
  const FileBytes bytes = read_bytes(file);
  return format == ScanFormat::kBinXyzi
             ? decode_bin(bytes.span(), hints.bin_columns, file.string(), most_scan_points)
             : decode_scan(bytes.span(), format, file.string(), most_scan_points, hints.stamp_ns);
}

}  // namespace stillmap::maps
