#include "evaluation/odometry/trajectory_errors.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <fmt/format.h>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kDegrees = 180.0 / std::numbers::pi;
/// The devkit's.
constexpr std::array<double, 8> kKittiLengthsM{100, 200, 300, 400, 500, 600, 700, 800};
constexpr std::size_t kKittiStep = 10;
constexpr std::array<double, 1> kShortLengthM{10};
/// A spread this much smaller than the largest one is rounding.
constexpr double kNoSpread = 1e-12;

void require_finite(Path path, const char* name) {
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (!path[i].matrix().allFinite())
      throw std::invalid_argument(
          fmt::format("{}: pose {} is not finite, expected numbers", name, i));
  }
}

void require_pair(Path truth, Path estimate) {
  if (truth.size() != estimate.size())
    throw std::invalid_argument(fmt::format("estimate: found {} poses, expected one for each of {}",
                                            estimate.size(), truth.size()));
  require_finite(truth, "truth");
  require_finite(estimate, "estimate");
}

SegmentError error_between(Path truth, Path estimate, std::size_t first, std::size_t last) {
  const Eigen::Isometry3d moved = truth[first].inverse() * truth[last];
  const Eigen::Isometry3d believed = estimate[first].inverse() * estimate[last];
  const Eigen::Isometry3d error = believed.inverse() * moved;
  return {.first = first,
          .last = last,
          .translation_m = error.translation().norm(),
          .rotation_rad = Eigen::AngleAxisd(error.linear()).angle()};
}

Eigen::Vector3d mean_of(Path path) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Isometry3d& pose : path) sum += pose.translation();
  return sum / static_cast<double>(path.size());
}

/// Mean of a segment's error over its length, NaN of no segments.
template <typename Error>
double mean_over(std::span<const SegmentError> segments, const Error& error) {
  if (segments.empty()) return kNaN;
  double sum = 0.0;
  for (const SegmentError& segment : segments) sum += error(segment);
  return sum / static_cast<double>(segments.size());
}

double percent_of_length(const SegmentError& segment) {
  return 100.0 * segment.translation_m / segment.length_m;
}

double degrees_per_100m(const SegmentError& segment) {
  return 100.0 * kDegrees * segment.rotation_rad / segment.length_m;
}

}  // namespace

std::vector<double> ways_m(Path path) {
  std::vector<double> ways(path.size(), 0.0);
  for (std::size_t i = 1; i < path.size(); ++i)
    ways[i] = ways[i - 1] + (path[i].translation() - path[i - 1].translation()).norm();
  return ways;
}

std::vector<SegmentError> segment_errors(Path truth, Path estimate,
                                         std::span<const double> lengths_m, std::size_t step) {
  require_pair(truth, estimate);
  const std::vector<double> ways = ways_m(truth);
  std::vector<SegmentError> segments;
  for (std::size_t first = 0; first < truth.size(); first += step) {
    for (const double length_m : lengths_m) {
      const auto end = std::upper_bound(ways.begin() + static_cast<std::ptrdiff_t>(first),
                                        ways.end(), ways[first] + length_m);
      if (end == ways.end()) continue;
      const auto last = static_cast<std::size_t>(end - ways.begin());
      SegmentError& segment = segments.emplace_back(error_between(truth, estimate, first, last));
      segment.length_m = length_m;
      segment.way_m = ways[last] - ways[first];
    }
  }
  return segments;
}

KittiErrors kitti_errors(Path truth, Path estimate) {
  const std::vector<SegmentError> all = segment_errors(truth, estimate, kKittiLengthsM, kKittiStep);
  KittiErrors errors{.segments = all.size(),
                     .translation_percent = mean_over(all, percent_of_length),
                     .rotation_deg_per_100m = mean_over(all, degrees_per_100m)};
  for (const double length_m : kKittiLengthsM) {
    std::vector<SegmentError> of_length;
    std::copy_if(all.begin(), all.end(), std::back_inserter(of_length),
                 [&](const SegmentError& segment) { return segment.length_m == length_m; });
    if (of_length.empty()) continue;
    errors.lengths.push_back({.length_m = length_m,
                              .segments = of_length.size(),
                              .translation_percent = mean_over(of_length, percent_of_length),
                              .rotation_deg_per_100m = mean_over(of_length, degrees_per_100m)});
  }
  return errors;
}

RelativeErrors relative_errors(Path truth, Path estimate) {
  const std::vector<SegmentError> segments = segment_errors(truth, estimate, kShortLengthM, 1);
  RelativeErrors errors;
  errors.segments_10m = segments.size();
  errors.translation_percent_10m = mean_over(segments, [](const SegmentError& segment) {
    return 100.0 * segment.translation_m / segment.way_m;
  });
  errors.rotation_deg_10m = mean_over(segments, [](const SegmentError& segment) {
    return kDegrees * segment.rotation_rad * segment.length_m / segment.way_m;
  });
  std::vector<double> translations_m, rotations_deg;
  for (std::size_t i = 1; i < truth.size(); ++i) {
    const SegmentError step = error_between(truth, estimate, i - 1, i);
    translations_m.push_back(step.translation_m);
    rotations_deg.push_back(kDegrees * step.rotation_rad);
  }
  errors.step_translation_m = figures_of(std::move(translations_m));
  errors.step_rotation_deg = figures_of(std::move(rotations_deg));
  return errors;
}

Eigen::Isometry3d alignment_of(Path truth, Path estimate) {
  require_pair(truth, estimate);
  if (truth.empty()) throw std::invalid_argument("estimate: found no pose, expected at least one");
  const Eigen::Vector3d truth_mean = mean_of(truth);
  const Eigen::Vector3d estimate_mean = mean_of(estimate);
  // The first poses upon each other: what is left to find is small, and decides where the
  // positions do not.
  const Eigen::Matrix3d R_start = truth.front().linear() * estimate.front().linear().transpose();
  Eigen::Matrix3d products = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < truth.size(); ++i)
    products += (truth[i].translation() - truth_mean) *
                (R_start * (estimate[i].translation() - estimate_mean)).transpose();
  const maps::SingularValues svd = maps::svd_of(products);
  const Eigen::Vector3d& spread = svd.values;
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  if (spread[1] > kNoSpread * spread[0]) {
    Eigen::Vector3d signs(1.0, 1.0, 1.0);
    if (svd.U.determinant() * svd.V.determinant() < 0.0) signs[2] = -1.0;
    R = svd.U * signs.asDiagonal() * svd.V.transpose();
  } else if (spread[0] > 0.0) {
    R = maps::turn_between(svd.V.col(0), svd.U.col(0)).toRotationMatrix();
  }
  Eigen::Isometry3d T_truth_estimate = Eigen::Isometry3d::Identity();
  T_truth_estimate.linear() = R * R_start;
  T_truth_estimate.translation() = truth_mean - T_truth_estimate.linear() * estimate_mean;
  return T_truth_estimate;
}

std::vector<double> distances_m(Path truth, Path estimate,
                                const Eigen::Isometry3d& T_truth_estimate) {
  require_pair(truth, estimate);
  std::vector<double> distances;
  distances.reserve(truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i)
    distances.push_back(
        (truth[i].translation() - T_truth_estimate * estimate[i].translation()).norm());
  return distances;
}

ErrorFigures figures_of(std::vector<double> values) {
  if (values.empty()) return {kNaN, kNaN, kNaN, kNaN};
  ErrorFigures figures;
  for (const double value : values) {
    figures.mean += value;
    figures.rmse += value * value;
  }
  const auto count = static_cast<double>(values.size());
  figures.mean /= count;
  figures.rmse = std::sqrt(figures.rmse / count);
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  figures.median = values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
  figures.max = values.back();
  return figures;
}

TrajectoryErrors trajectory_errors(Path truth, Path estimate) {
  TrajectoryErrors errors;
  errors.T_truth_estimate = alignment_of(truth, estimate);
  errors.poses = truth.size();
  errors.kitti = kitti_errors(truth, estimate);
  errors.relative = relative_errors(truth, estimate);
  const std::vector<double> ways = ways_m(truth);
  const std::vector<double> aligned = distances_m(truth, estimate, errors.T_truth_estimate);
  const std::vector<double> from_start =
      distances_m(truth, estimate, truth.front() * estimate.front().inverse());
  errors.way_m = ways.back();
  for (std::size_t i = 0; i < ways.size(); ++i)
    errors.course_m.push_back({ways[i], aligned[i], from_start[i]});
  errors.aligned_m = figures_of(aligned);
  errors.from_start_m = figures_of(from_start);
  return errors;
}

}  // namespace stillmap::mapping
