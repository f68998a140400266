#include "sweeps.hpp"

#include <mrpt/maps/CPointsMapXYZI.h>
#include <mrpt/maps/CSimplePointsMap.h>
#include <mrpt/obs/CObservation3DRangeScan.h>
#include <mrpt/obs/CObservationPointCloud.h>
#include <mrpt/obs/CObservationVelodyneScan.h>

#include <algorithm>

namespace stillmap::maps::rawlog {
namespace {

/// Of coordinates in vectors of their own; nothing of vectors of different lengths.
template <typename Values>
void set_coordinates(const Values& x, const Values& y, const Values& z, Sweep& sweep) {
  if (x.size() != y.size() || x.size() != z.size() || x.size() > kMostRawlogPoints) return;
  sweep.points.resize(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    sweep.points[i].x = x[i];
    sweep.points[i].y = y[i];
    sweep.points[i].z = z[i];
  }
}

Sweep sweep_of_cloud(const mrpt::obs::CObservationPointCloud& observation) {
  Sweep sweep;
  if (observation.isExternallyStored() || !observation.pointcloud) return sweep;
  const mrpt::maps::CPointsMap& cloud = *observation.pointcloud;
  set_coordinates(cloud.getPointsBufferRef_x(), cloud.getPointsBufferRef_y(),
                  cloud.getPointsBufferRef_z(), sweep);
  const auto* bright = dynamic_cast<const mrpt::maps::CPointsMapXYZI*>(&cloud);
  if (bright == nullptr || bright->getPointsBufferRef_intensity().size() != sweep.points.size())
    return sweep;
  sweep.has_intensities = true;
  for (std::size_t i = 0; i < sweep.points.size(); ++i)
    sweep.points[i].intensity = bright->getPointsBufferRef_intensity()[i];
  return sweep;
}

Sweep sweep_of_image(mrpt::obs::CObservation3DRangeScan& observation) {
  Sweep sweep;
  if (observation.hasPoints3D) {
    if (!observation.points3D_isExternallyStored())
      set_coordinates(observation.points3D_x, observation.points3D_y, observation.points3D_z,
                      sweep);
    return sweep;
  }
  const bool is_sound = observation.hasRangeImage && !observation.rangeImage_isExternallyStored() &&
                        observation.rangeImage.size() <= kMostRawlogPoints;
  if (!is_sound) return sweep;
  mrpt::maps::CSimplePointsMap cloud;
  mrpt::obs::T3DPointsProjectionParams projection;
  projection.takeIntoAccountSensorPoseOnRobot = false;
  observation.unprojectInto(cloud, projection);
  set_coordinates(cloud.getPointsBufferRef_x(), cloud.getPointsBufferRef_y(),
                  cloud.getPointsBufferRef_z(), sweep);
  return sweep;
}

Sweep sweep_of_velodyne(mrpt::obs::CObservationVelodyneScan& observation) {
  auto& cloud = observation.point_cloud;
  if (cloud.size() == 0 && !observation.scan_packets.empty()) {
    mrpt::obs::CObservationVelodyneScan::TGeneratePointCloudParameters parameters;
    parameters.generatePerPointTimestamp = true;
    parameters.minDistance = 0.0F;
    observation.generatePointCloud(parameters);
  }
  Sweep sweep;
  set_coordinates(cloud.x, cloud.y, cloud.z, sweep);
  sweep.has_intensities = cloud.intensity.size() == sweep.points.size();
  sweep.has_times = cloud.timestamp.size() == sweep.points.size();
  for (std::size_t i = 0; i < sweep.points.size(); ++i) {
    if (sweep.has_intensities) sweep.points[i].intensity = cloud.intensity[i];
    if (sweep.has_times)
      sweep.points[i].time_s = static_cast<float>(
          mrpt::system::timeDifference(observation.timestamp, cloud.timestamp[i]));
  }
  return sweep;
}

}  // namespace

std::optional<Sweep> sweep_of(mrpt::obs::CObservation& observation) {
  using namespace mrpt::obs;
  if (const auto* cloud = dynamic_cast<const CObservationPointCloud*>(&observation))
    return sweep_of_cloud(*cloud);
  if (auto* image = dynamic_cast<CObservation3DRangeScan*>(&observation))
    return sweep_of_image(*image);
  if (auto* velodyne = dynamic_cast<CObservationVelodyneScan*>(&observation))
    return sweep_of_velodyne(*velodyne);
  return std::nullopt;
}

}  // namespace stillmap::maps::rawlog
