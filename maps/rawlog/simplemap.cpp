#include "simplemap.hpp"

#include <mrpt/maps/CPointsMapXYZI.h>
#include <mrpt/maps/CSimpleMap.h>
#include <mrpt/obs/CObservationPointCloud.h>
#include <mrpt/obs/CSensoryFrame.h>
#include <mrpt/poses/CPose3DPDFGaussian.h>
#include <mrpt/serialization/CArchive.h>

#include <stdexcept>
#include <vector>

#include "packed_output.hpp"
#include "rawlogs/rawlog_record.hpp"
#include "times.hpp"

namespace stillmap::maps::rawlog {
namespace {

mrpt::poses::CPose3D pose_of(const RawlogRecord& record) {
  mrpt::math::CMatrixDouble33 R;
  mrpt::math::CVectorFixedDouble<3> t;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column)
      R(row, column) = record.pose[static_cast<std::size_t>(4 * row + column)];
    t[row] = record.pose[static_cast<std::size_t>(4 * row + 3)];
  }
  return {R, t};
}

mrpt::obs::CObservationPointCloud::Ptr observation_of(const RawlogRecord& record,
                                                      const std::vector<RawlogPoint>& points) {
  auto cloud = mrpt::maps::CPointsMapXYZI::Create();
  cloud->reserve(points.size());
  for (const RawlogPoint& p : points)
    cloud->insertPointRGB(p.x, p.y, p.z, p.intensity, p.intensity, p.intensity);
  auto observation = mrpt::obs::CObservationPointCloud::Create();
  observation->sensorLabel = "stillmap";
  observation->timestamp = time_of(record.stamp_ns);
  observation->pointcloud = cloud;
  return observation;
}

}  // namespace

void write_simplemap(std::FILE* records, const std::string& file) {
  PackedOutput stream(file);
  mrpt::maps::CSimpleMap map;
  RawlogRecord record;
  const auto get = [&](void* to, std::size_t size) {
    if (std::fread(to, 1, size, records) != size)
      throw std::runtime_error("the records of its keyframes break off");
  };
  for (get(&record, sizeof record); record.kind != RawlogRecordKind::kEnd;
       get(&record, sizeof record)) {
    std::vector<RawlogPoint> points(record.points);
    get(points.data(), points.size() * sizeof(RawlogPoint));
    mrpt::obs::CSensoryFrame frame;
    frame.insert(observation_of(record, points));
    map.insert(mrpt::poses::CPose3DPDFGaussian(pose_of(record)), frame);
  }
  mrpt::serialization::archiveFrom(stream) << map;
  stream.close();
}

}  // namespace stillmap::maps::rawlog
