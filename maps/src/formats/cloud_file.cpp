#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/mapped_file.hpp>

#include <stdexcept>

#include "formats/las.hpp"
#include "formats/pcd.hpp"
#include "formats/ply.hpp"

namespace stillmap::maps {
namespace {

/// The system counts pages of a mapped file as this process's memory, until they are let go.
constexpr std::uint64_t kPointsHeld = 1'000'000;

}  // namespace

void check_cloud_header(std::span<const std::byte> head, std::string_view format,
                        const std::string& name) {
  if (format == "pcd") return check_pcd_header(head, name);
  if (format == "ply") return check_ply_header(head, name);
  if (format == "las") return check_las_header(head, name);
  throw std::invalid_argument("format: '" + std::string(format) + "', pcd, ply or las expected");
}

CloudSummary read_cloud_file(const std::filesystem::path& file,
                             const std::function<void(std::span<const CloudPoint>)>& take) {
  const std::string extension = file.extension().string();
  if (extension == ".laz")
    throw InputError(file.string(), "LAZ, compressed points",
                     "LAS, uncompressed: `pdal translate IN.laz OUT.las`, or `laszip -i IN.laz -o "
                     "OUT.las`");
  if (extension != ".pcd" && extension != ".ply" && extension != ".las")
    throw InputError(file.string(), "extension '" + extension + "'",
                     ".pcd, .ply or .las: convert the file");
  const MappedFile mapped(file, MappedFile::Reading::kInOrder);
  std::uint64_t points = 0;
  const auto take_and_release = [&](std::span<const CloudPoint> some) {
    take(some);
    const std::uint64_t before = points / kPointsHeld;
    points += some.size();
    if (points / kPointsHeld != before) mapped.release_pages();
  };
  if (extension == ".las") return stream_las(mapped.bytes(), file.string(), take_and_release);
  return extension == ".pcd" ? stream_pcd(mapped.bytes(), file.string(), take_and_release)
                             : stream_ply(mapped.bytes(), file.string(), take_and_release);
}

}  // namespace stillmap::maps
