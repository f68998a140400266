// Writes a drive as an MRPT rawlog: a cloud and the robot's pose for each scan.
// usage: make_rawlog DRIVE FILE
#include <mrpt/io/CFileGZOutputStream.h>
#include <mrpt/maps/CPointsMapXYZI.h>
#include <mrpt/obs/CObservationPointCloud.h>
#include <mrpt/obs/CObservationRobotPose.h>
#include <mrpt/serialization/CArchive.h>
#include <stillmap/maps/drive.hpp>

#include <cstdio>
#include <exception>

namespace {

void write(const stillmap::maps::Drive& drive, const char* file) {
  mrpt::io::CFileGZOutputStream stream(file);
  auto archive = mrpt::serialization::archiveFrom(stream);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const mrpt::Clock::time_point time(
        mrpt::Clock::duration(drive.stamp_ns(i) / 100 + 116'444'736'000'000'000));
    mrpt::obs::CObservationRobotPose pose;
    pose.timestamp = time;
    pose.pose.mean = mrpt::poses::CPose3D(
        mrpt::math::CMatrixDouble44(Eigen::Matrix4d(drive.T_map_lidar(i).matrix())));
    archive << pose;
    const stillmap::maps::PointCloud cloud = drive.read(i).cloud;
    auto points = mrpt::maps::CPointsMapXYZI::Create();
    points->reserve(cloud.size());
    for (const Eigen::Vector3f& p : cloud.positions) points->insertPointFast(p.x(), p.y(), p.z());
    for (std::size_t k = 0; k < cloud.size(); ++k)
      points->setPointIntensity(k, cloud.intensities[k]);
    mrpt::obs::CObservationPointCloud observation;
    observation.timestamp = time;
    observation.sensorLabel = "lidar";
    observation.pointcloud = points;
    archive << observation;
  }
}

}  // namespace

int main(int count, char** words) {
  if (count != 3) return 2;
  try {
    write(stillmap::maps::Drive::open(words[1]), words[2]);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
