#include <fmt/format.h>

#include <iterator>

#include "exports/exporters.hpp"
#include "exports/file_coordinates.hpp"
#include "exports/output_file.hpp"

namespace stillmap::maps {

void export_ply(ExportJob& job) {
  const FileCoordinates coordinates(job.map, job.frame);
  const std::uint64_t points = count_chosen(job);
  std::string header = "ply\nformat binary_little_endian 1.0\n";
  for (const std::string& line : frame_lines(job.map, coordinates))
    header += "comment " + line + "\n";
  header += "comment kind 0 measured, 1 measured ground, 2 moved down from an object, 3 filled\n";
  fmt::format_to(std::back_inserter(header),
                 "element vertex {}\nproperty double x\nproperty double y\nproperty double z\n"
                 "property float intensity\nproperty uchar kind\nend_header\n",
                 points);
  OutputFile file(job.target);
  file.write(header);
  visit_chosen(job, [&](const MapTile& tile, const MapPoint& point) {
    const Eigen::Vector3d p = coordinates(tile, point);
    for (const double value : {p.x(), p.y(), p.z()}) file.put(value);
    file.put(point.intensity);
    file.put(static_cast<std::uint8_t>(point.kind));
  });
  file.close();
}

}  // namespace stillmap::maps
