#include <stillmap/maps/error.hpp>
#include <stillmap/maps/scan_file.hpp>

#include "formats/bin.hpp"
#include "formats/file_bytes.hpp"
#include "formats/pcd.hpp"
#include "formats/ply.hpp"

namespace stillmap::maps {
namespace {

ScanFormat format_of(const std::filesystem::path& file) {
  const std::string extension = file.extension().string();
  if (extension == ".bin") return ScanFormat::kBinXyzi;
  if (extension == ".pcd") return ScanFormat::kPcd;
  if (extension == ".ply") return ScanFormat::kPly;
  throw InputError(file.string(), "extension '" + extension + "'", ".bin, .pcd or .ply");
}

}  // namespace

DecodedScan decode_scan(std::span<const std::byte> bytes, ScanFormat format,
                        const std::string& name, std::size_t max_points) {
  switch (format) {
    case ScanFormat::kBinXyzi:
      return decode_bin(bytes, true, name, max_points);
    case ScanFormat::kBinXyz:
      return decode_bin(bytes, false, name, max_points);
    case ScanFormat::kPcd:
      return decode_pcd(bytes, name, max_points);
    case ScanFormat::kPly:
      return decode_ply(bytes, name, max_points);
  }
  throw std::invalid_argument("decode_scan: unknown format");
}

DecodedScan read_scan_file(const std::filesystem::path& file) {
  const ScanFormat format = format_of(file);
  return decode_scan(read_bytes(file).span(), format, file.string());
}

}  // namespace stillmap::maps
