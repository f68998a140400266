// What the program that reads MRPT's rawlogs says of one: records with text and points behind them,
// by a process that a hostile rawlog may have taken over.
#include "fuzz_target.hpp"

#include <array>

#include "rawlogs/rawlog_survey.hpp"

namespace {

using namespace stillmap;

void require_rigid(const Eigen::Isometry3d& T) {
  fuzz::require(T.matrix().allFinite(), "poses are finite");
  const Eigen::Matrix3d R = T.linear();
  fuzz::require((R.transpose() * R).isIdentity(1e-2), "rotations are such");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  maps::RawlogSurvey survey;
  survey.records.append(data, size);
  maps::survey_records(survey, {});
  for (const auto& [label, scans] : survey.scans_of_label) {
    fuzz::require(label.size() <= maps::kMostRawlogText, "labels are short");
    for (const maps::RawlogScan& scan : scans) {
      require_rigid(scan.T_base_lidar);
      std::vector<maps::RawlogPoint> points(scan.points);
      fuzz::require(survey.records.read(scan.offset, points.data(),
                                        points.size() * sizeof(maps::RawlogPoint)),
                    "points are there");
    }
  }
  for (const auto source : {maps::RawlogPoseSource::kActions, maps::RawlogPoseSource::kOdometry,
                            maps::RawlogPoseSource::kRobotPose}) {
    std::size_t poses = 0;
    survey.for_each_pose(source, [&](std::int64_t, const Eigen::Isometry3d& T) {
      require_rigid(T);
      ++poses;
    });
    fuzz::require(poses <= survey.poses[static_cast<std::size_t>(source)], "no more than counted");
  }
  return 0;
}
