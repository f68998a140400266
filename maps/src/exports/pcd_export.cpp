#include <fmt/format.h>

#include <iterator>

#include "exports/exporters.hpp"
#include "exports/file_coordinates.hpp"
#include "exports/output_file.hpp"
#include "exports/pcd_bytes.hpp"

namespace stillmap::maps {

std::string pcd_header(std::uint64_t points, bool kinds, const std::vector<std::string>& comments) {
  std::string text = "# .PCD v0.7 - Point Cloud Data file format\n";
  for (const std::string& comment : comments) text += "# " + comment + "\n";
  fmt::format_to(std::back_inserter(text),
                 "VERSION 0.7\nFIELDS x y z intensity{}\nSIZE 4 4 4 4{}\nTYPE F F F F{}\n"
                 "COUNT 1 1 1 1{}\nWIDTH {}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\n"
                 "DATA binary\n",
                 kinds ? " kind" : "", kinds ? " 1" : "", kinds ? " U" : "", kinds ? " 1" : "",
                 points, points);
  return text;
}

void put_pcd_point(OutputFile& file, const Eigen::Vector3f& p, float intensity) {
  for (const float value : {p.x(), p.y(), p.z(), intensity}) file.put(value);
}

void export_pcd(ExportJob& job) {
  require_fine_floats(job.map, job.result.origin,
                      job.frame == ExportFrame::kMap
                          ? "finer ones: give --coordinates local (from a place in the map), or "
                            "--format ply or las"
                          : "finer ones: give --format ply or las");
  const FileCoordinates coordinates(job.map, job.frame);
  const std::uint64_t points = count_chosen(job);
  OutputFile file(job.target);
  file.write(pcd_header(points, job.options.kinds, frame_lines(job.map, coordinates)));
  visit_chosen(job, [&](const MapTile& tile, const MapPoint& point) {
    put_pcd_point(file, coordinates(tile, point).cast<float>(), point.intensity);
    if (job.options.kinds) file.put(static_cast<std::uint8_t>(point.kind));
  });
  file.close();
}

}  // namespace stillmap::maps
