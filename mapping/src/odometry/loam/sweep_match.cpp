#include "odometry/loam/sweep_match.hpp"

#include <stillmap/maps/frames.hpp>

#include <algorithm>

namespace stillmap::mapping::loam {
namespace {

/// Rounds of looking for correspondences anew; a match that has settled ends earlier.
constexpr int kRounds = 15;
/// Reach of the weights at the end [m], and what it shrinks by from round to round.
constexpr double kLastReachM = 0.3;
constexpr double kShrink = 0.7;
/// Fewer correspondences do not make a motion.
constexpr std::size_t kMinCorrespondences = 30;

std::vector<Correspondence> correspondences(const Features& features, double period_s,
                                            const PreviousSweep& previous, const Motion& T) {
  std::vector<Correspondence> out;
  out.reserve(features.edges.size() + features.planes.size());
  PartOfMotion part(T);
  const auto add = [&](const Feature& f, const auto& search) {
    Correspondence c;
    c.X = f.position.cast<double>();
    c.share.way = share_of(f.time_s, period_s);
    c.share.turn = f.is_turned ? 1.0 : c.share.way;
    part.go_to(c.share);
    const auto surface = search((part * c.X).cast<float>());
    if (!surface) return;
    c.surface = *surface;
    out.push_back(c);
  };
  for (const Feature& f : features.edges) {
    add(f, [&](const Eigen::Vector3f& X) { return previous.edges.line_near(X); });
  }
  for (const Feature& f : features.planes) {
    add(f, [&](const Eigen::Vector3f& X) { return previous.planes.plane_near(X); });
  }
  return out;
}

}  // namespace

std::vector<Feature> at_stamp(const std::vector<Feature>& features,
                              const Eigen::Matrix<double, 6, 1>& twist_lidar) {
  std::vector<Feature> out = features;
  Eigen::Isometry3f T = Eigen::Isometry3f::Identity();
  float time_s = 0.0F;
  for (Feature& f : out) {
    if (f.is_turned) {
      f.position += (twist_lidar.head<3>() * static_cast<double>(f.time_s)).cast<float>();
      f.time_s = 0.0F;
      continue;
    }
    if (f.time_s != time_s) {
      time_s = f.time_s;
      T = maps::exp_se3(twist_lidar * static_cast<double>(time_s)).cast<float>();
    }
    f.position = T * f.position;
    f.time_s = 0.0F;
  }
  return out;
}

SweepMatch match_sweep(const Features& features, double period_s, const PreviousSweep& previous,
                       const Motion& predicted, double off_m) {
  SweepMatch match;
  match.T = predicted;
  Told told;
  double reach_m = std::max(kLastReachM, off_m);
  for (int round = 0; round < kRounds; ++round) {
    const auto found = correspondences(features, period_s, previous, match.T);
    if (found.size() < kMinCorrespondences) return match;
    if (round == 0) {
      told = told_by(found, match.T);
      match.untold = told.untold;
    }
    const MotionFit fit = fit_motion(found, match.T, told, reach_m);
    match.T = fit.T;
    match.inlier_ratio = static_cast<double>(inliers(found, fit.T)) /
                         static_cast<double>(features.edges.size() + features.planes.size());
    if (fit.settled && reach_m <= kLastReachM) break;
    reach_m = std::max(kLastReachM, kShrink * reach_m);
  }
  return match;
}

}  // namespace stillmap::mapping::loam
