#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/error.hpp>

#include <stdexcept>

#include "formats/las.hpp"
#include "formats/mapped_file.hpp"
#include "formats/pcd.hpp"
#include "formats/ply.hpp"

namespace stillmap::maps {

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
    throw InputError(file.string(), "extension '" + extension + "'", ".pcd, .ply or .las");
  const MappedFile bytes(file);
  if (extension == ".las") return stream_las(bytes.span(), file.string(), take);
  return extension == ".pcd" ? stream_pcd(bytes.span(), file.string(), take)
                             : stream_ply(bytes.span(), file.string(), take);
}

}  // namespace stillmap::maps
