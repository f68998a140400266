#include "output/truth_writer.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <span>

#include "output/file_output.hpp"

namespace stillmap::simulation {
namespace {

constexpr double kTruthStepS = 0.001;

constexpr std::string_view kReadme = R"(# Truth of a simulated drive

What no recording has. Files of a scan carry the name of the scan's own file.

- `trajectory.txt`: the lidar's true path, TUM (`stamp tx ty tz qx qy qz qw`, T_map_lidar), each
  millisecond from half a period before the first scan's stamp to half a period after the last one's,
  on the drive's clock.
- `times/*.bin`: float32 each, when each point of the scan was measured, relative to the scan's
  stamp [s].
- `behind/*.bin`, `behind/*.label`: what those rays that met an object, or were lost on it, would have
  met without it. float32 x y z intensity and SemanticKITTI labels (uint32), in the convention of the
  scans: {}.
- `ground.ply`: the ground as triangles, in the map frame, with the SemanticKITTI class of each face as
  `label`.

Little endian. The map frame is that of the drive's poses: {}.
)";

std::string readme_of(const LayoutWriter& layout) {
  const char* convention =
      layout.at_stamp() ? "the lidar frame at the stamp, where all points of a scan were moved to"
                        : "the lidar frame at each point's own time, as measured";
  const Eigen::Vector3d origin = layout.T_map_world().inverse().translation();
  const std::string frame =
      fmt::format("its origin lies at ({:.3f}, {:.3f}, {:.3f}) m of the simulated world",
                  origin.x(), origin.y(), origin.z());
  return fmt::format(fmt::runtime(kReadme), convention, frame);
}

std::string ply_bytes(const Mesh& mesh, const Eigen::Isometry3d& T_map_world) {
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment ground in the map frame [m]\n"
      "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "element face {}\nproperty list uchar int vertex_indices\nproperty int label\nend_header\n",
      mesh.vertices.size(), mesh.triangles.size());
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    const Eigen::Vector3f p = (T_map_world * vertex.cast<double>()).cast<float>();
    for (int axis = 0; axis < 3; ++axis) append(bytes, p[axis]);
  }
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    append(bytes, std::uint8_t{3});
    for (const std::uint32_t vertex : mesh.triangles[i]) {
      append(bytes, static_cast<std::int32_t>(vertex));
    }
    append(bytes, static_cast<std::int32_t>(properties_of(mesh.materials[i].surface).label));
  }
  return bytes;
}

}  // namespace

TruthWriter::TruthWriter(const std::filesystem::path& drive_folder)
    : folder_(drive_folder / "truth") {
  make_folder(folder_ / "times");
  make_folder(folder_ / "behind");
}

void TruthWriter::add(const std::string& stem, const SimulatedScan& scan,
                      const std::vector<Eigen::Vector3f>& behind) {
  write_file(folder_ / "times" / (stem + ".bin"),
             std::as_bytes(std::span(scan.points.time_offsets_s)));
  write_bin(folder_ / "behind" / (stem + ".bin"), behind, scan.behind.intensities);
  write_file(folder_ / "behind" / (stem + ".label"), std::as_bytes(std::span(scan.behind.labels)));
  if (!any_) first_stamp_s_ = scan.stamp_s;
  any_ = true;
  last_stamp_s_ = scan.stamp_s;
}

void TruthWriter::finish(const LayoutWriter& layout, const TruePath& T_world_lidar, double period_s,
                         const Mesh& ground) {
  const Eigen::Isometry3d T_map_world = layout.T_map_world();
  TextFile trajectory(folder_ / "trajectory.txt");
  const double begin_s = first_stamp_s_ - 0.5 * period_s;
  const double length_s = any_ ? last_stamp_s_ - first_stamp_s_ + period_s : 0.0;
  const auto steps = static_cast<std::size_t>(std::lround(length_s / kTruthStepS));
  for (std::size_t step = 0; any_ && step <= steps; ++step) {
    const double time_s = begin_s + kTruthStepS * static_cast<double>(step);
    trajectory.append(tum_line_of(layout.stamp_ns(time_s), T_map_world * T_world_lidar(time_s)));
  }
  trajectory.close();
  write_file(folder_ / "ground.ply", ply_bytes(ground, T_map_world));
  write_file(folder_ / "README.md", readme_of(layout));
}

}  // namespace stillmap::simulation
