#include "pipeline/surveyed_scan_bytes.hpp"

#include "pipeline/record_bytes.hpp"

namespace stillmap::mapping {

// Taken apart by structured bindings: a field that is added stops these from compiling.

static void put(std::string& bytes, const GroundCells::Cell& cell) {
  const auto& [x, y, z, offset_x, offset_y, weight, in_box] = cell;
  put_each(bytes, x, y, z, offset_x, offset_y, weight, in_box);
}

static void put(std::string& bytes, const ScanObstacles::Voxel& voxel) {
  const auto& [key, sum, points] = voxel;
  put_each(bytes, key, sum, points);
}

static void get(ByteReader& reader, GroundCells::Cell& cell) {
  auto& [x, y, z, offset_x, offset_y, weight, in_box] = cell;
  get_each(reader, x, y, z, offset_x, offset_y, weight, in_box);
}

static void get(ByteReader& reader, ScanObstacles::Voxel& voxel) {
  auto& [key, sum, points] = voxel;
  get_each(reader, key, sum, points);
}

std::string to_bytes(const SurveyedScan& surveyed) {
  const auto& [scan, sha256, is_ground, weather, boxes, ground, obstacles, view, counts, seconds] =
      surveyed;
  const auto& [cells] = ground;
  const auto& [voxels] = obstacles;
  std::string bytes;
  put_each(bytes, scan, sha256, is_ground, weather);
  put_all(bytes, boxes);
  put_all(bytes, cells);
  put_all(bytes, voxels);
  put(bytes, std::string_view(view.value().to_bytes()));
  put_all(bytes, counts);
  put_all(bytes, seconds);
  return bytes;
}

SurveyedScan surveyed_scan_from(std::string_view bytes) {
  ByteReader reader(bytes, "surveyed scan");
  SurveyedScan scan;
  std::string view;
  get_each(reader, scan.scan, scan.sha256, scan.is_ground, scan.weather);
  get_all(reader, scan.boxes);
  get_all(reader, scan.ground_cells.cells);
  get_all(reader, scan.obstacles.voxels);
  get(reader, view);
  get_all(reader, scan.counts);
  get_all(reader, scan.stage_seconds);
  reader.end();
  scan.view = RangeView::from_bytes(view);
  return scan;
}

}  // namespace stillmap::mapping
