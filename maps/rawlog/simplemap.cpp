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
  for (const RawlogPoint& p : points) cloud->insertPointFast(p.x, p.y, p.z);
  for (std::size_t i = 0; i < points.size(); ++i) cloud->setPointIntensity(i, points[i].intensity);
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
  while (std::fread(&record, sizeof record, 1, records) == 1) {
    std::vector<RawlogPoint> points(record.points);
    if (std::fread(points.data(), sizeof(RawlogPoint), points.size(), records) != points.size())
      throw std::runtime_error("the records of its keyframes break off");
    mrpt::obs::CSensoryFrame frame;
    frame.insert(observation_of(record, points));
    map.insert(mrpt::poses::CPose3DPDFGaussian(pose_of(record)), frame);
  }
  if (std::ferror(records) != 0)
    throw std::runtime_error("the records of its keyframes cannot be read");
  mrpt::serialization::archiveFrom(stream) << map;
  stream.close();
}

}  // namespace stillmap::maps::rawlog
