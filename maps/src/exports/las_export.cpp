#include <fmt/format.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "exports/crs_text.hpp"
#include "exports/exporters.hpp"
#include "exports/file_coordinates.hpp"
#include "exports/output_file.hpp"

namespace stillmap::maps {
namespace {

constexpr std::uint16_t kHeaderBytes = 375;
constexpr std::uint16_t kRecordHeaderBytes = 54;
constexpr std::uint16_t kPointBytes = 30;
constexpr std::uint8_t kPointFormat = 6;
constexpr std::uint16_t kWktBit = 1U << 4U;
constexpr std::uint16_t kWktRecord = 2112;
constexpr double kScaleM = 0.001;
constexpr std::uint8_t kSynthetic = 1;
// Classes of the ASPRS.
constexpr std::uint8_t kUnclassified = 1;
constexpr std::uint8_t kGround = 2;

using Whole = Eigen::Matrix<std::int32_t, 3, 1>;

/// What the header says of the points.
struct LasSummary {
  std::uint64_t points = 0;
  /// Whole metres.
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  Whole min = Whole::Constant(std::numeric_limits<std::int32_t>::max());
  Whole max = Whole::Constant(std::numeric_limits<std::int32_t>::min());

  [[nodiscard]] double coordinate(std::int32_t whole, Eigen::Index axis) const {
    return whole * kScaleM + offset[axis];
  }
};

/// Text in a field of fixed width, filled with zeros.
void put_text(OutputFile& file, std::string_view text, std::size_t width) {
  std::string field(text.substr(0, width));
  field.resize(width, '\0');
  file.write(field);
}

/// The header of LAS 1.4 R15, table 3. Dates and ids are left at zero, so that equal maps are equal
/// files.
void put_header(OutputFile& file, const LasSummary& summary, const std::string& wkt) {
  file.write("LASF");
  file.put<std::uint16_t>(0);
  file.put(kWktBit);
  put_text(file, "", 16);
  file.put<std::uint8_t>(1);
  file.put<std::uint8_t>(4);
  put_text(file, "stillmap", 32);
  put_text(file, "stillmap " STILLMAP_VERSION, 32);
  file.put<std::uint32_t>(0);
  file.put(kHeaderBytes);
  file.put(static_cast<std::uint32_t>(kHeaderBytes + kRecordHeaderBytes + wkt.size() + 1));
  file.put<std::uint32_t>(1);
  file.put(kPointFormat);
  file.put(kPointBytes);
  // Numbers of points of older versions, which have no format 6.
  put_text(file, "", 24);
  for (int axis = 0; axis < 3; ++axis) file.put(kScaleM);
  for (Eigen::Index axis = 0; axis < 3; ++axis) file.put(summary.offset[axis]);
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    file.put(summary.coordinate(summary.max[axis], axis));
    file.put(summary.coordinate(summary.min[axis], axis));
  }
  put_text(file, "", 20);
  file.put(summary.points);
  // All are first returns of one.
  file.put(summary.points);
  put_text(file, "", std::size_t{14} * 8);
}

void put_wkt(OutputFile& file, const std::string& wkt) {
  file.put<std::uint16_t>(0);
  put_text(file, "LASF_Projection", 16);
  file.put(kWktRecord);
  file.put(static_cast<std::uint16_t>(wkt.size() + 1));
  put_text(file, "OGC Coordinate System WKT", 32);
  put_text(file, wkt, wkt.size() + 1);
}

/// Intensities are 16 bits in LAS; sensors have them up to 1, 255 or 65535.
double intensity_scale(ExportJob& job) {
  float most = 0.0F;
  for (const TileEntry& tile : point_tiles(job.map))
    for (const MapPoint& point : job.map.tile(tile.id)) most = std::max(most, point.intensity);
  const double scale = most <= 1.0F ? 65535.0 : most <= 255.0F ? 257.0 : 1.0;
  job.result.notes.push_back(fmt::format("intensities are times {}, up to {}", scale, most));
  return scale;
}

void put_point(OutputFile& file, const Whole& p, const MapPoint& point, double scale) {
  for (Eigen::Index axis = 0; axis < 3; ++axis) file.put(p[axis]);
  const double intensity = std::min(std::round(point.intensity * scale), 65535.0);
  // What is no number is none.
  file.put(static_cast<std::uint16_t>(intensity > 0.0 ? intensity : 0.0));
  file.put<std::uint8_t>(1U | 1U << 4U);
  file.put<std::uint8_t>(is_measured(point.kind) ? 0 : kSynthetic);
  file.put(point.kind == PointKind::kMeasured ? kUnclassified : kGround);
  file.put(static_cast<std::uint8_t>(point.kind));
  file.put<std::int16_t>(0);
  file.put<std::uint16_t>(0);
  file.put(0.0);
}

Whole to_whole(const Eigen::Vector3d& p, const LasSummary& summary, const ExportJob& job) {
  const Eigen::Vector3d whole = ((p - summary.offset) / kScaleM).array().round();
  if (!(whole.cwiseAbs().maxCoeff() < 2147483647.0))
    throw InputError(job.map.folder().string(), fmt::format("a point at {}", exact_text(p)),
                     "all within 2147 km, as LAS holds them: give --coordinates local");
  return whole.cast<std::int32_t>();
}

std::string wkt_of(ExportJob& job, const FileCoordinates& coordinates) {
  const MapManifest& manifest = job.map.manifest();
  if (const auto& utm = coordinates.utm()) {
    job.result.notes.push_back(fmt::format(
        "EPSG:{}, height above the WGS 84 ellipsoid: lengths differ from the map's by the scale of "
        "the zone, up to 1 in 1000",
        utm->zone().epsg()));
    return utm_wkt(utm->zone());
  }
  return local_wkt(manifest.frame_id, manifest.geodetic_origin.has_value());
}

}  // namespace

void export_las(ExportJob& job) {
  const FileCoordinates coordinates(job.map, job.frame);
  LasSummary summary;
  summary.points = count_chosen(job);
  // Of any point: the map is not far from it.
  const MapTile first = job.map.tile(point_tiles(job.map).front().id);
  summary.offset = coordinates(first, first[0]).array().round();
  const double scale = intensity_scale(job);
  const std::string wkt = wkt_of(job, coordinates);
  OutputFile file(job.target);
  put_header(file, summary, wkt);
  put_wkt(file, wkt);
  visit_chosen(job, [&](const MapTile& tile, const MapPoint& point) {
    const Whole p = to_whole(coordinates(tile, point), summary, job);
    summary.min = summary.min.cwiseMin(p);
    summary.max = summary.max.cwiseMax(p);
    put_point(file, p, point, scale);
  });
  // Once more, with the bounds.
  file.rewind();
  put_header(file, summary, wkt);
  file.close();
}

}  // namespace stillmap::maps
