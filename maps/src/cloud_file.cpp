#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/error.hpp>

#include <stdexcept>

#include "formats/mapped_file.hpp"
#include "formats/pcd.hpp"
#include "formats/ply.hpp"

namespace stillmap::maps {

void check_cloud_header(std::span<const std::byte> head, std::string_view format,
                        const std::string& name) {
  if (format == "pcd") return check_pcd_header(head, name);
  if (format == "ply") return check_ply_header(head, name);
  throw std::invalid_argument("format: '" + std::string(format) + "', pcd or ply expected");
}

CloudSummary read_cloud_file(const std::filesystem::path& file,
                             const std::function<void(std::span<const CloudPoint>)>& take) {
  const std::string extension = file.extension().string();
  if (extension != ".pcd" && extension != ".ply")
    throw InputError(file.string(), "extension '" + extension + "'", ".pcd or .ply");
  const MappedFile bytes(file);
  return extension == ".pcd" ? stream_pcd(bytes.span(), file.string(), take)
                             : stream_ply(bytes.span(), file.string(), take);
}

}  // namespace stillmap::maps
