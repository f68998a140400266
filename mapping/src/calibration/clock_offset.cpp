#include "calibration/clock_offset.hpp"

#include <stillmap/maps/frames.hpp>

#include <array>
#include <cmath>
#include <optional>

namespace stillmap::mapping {
namespace {

constexpr double kMostOffsetS = 0.5;
constexpr double kOffsetStepS = 0.01;
constexpr int kOffsets = 2 * static_cast<int>(kMostOffsetS / kOffsetStepS) + 1;
constexpr std::size_t kParts = 10;
/// Rates are means over as much [ns].
constexpr std::int64_t kRateNs = 200'000'000;

std::optional<double> rate_at(const maps::Trajectory& path, std::int64_t stamp_ns) {
  const auto before = path.at(stamp_ns - kRateNs / 2, 0.0);
  const auto after = path.at(stamp_ns + kRateNs / 2, 0.0);
  if (!before || !after) return std::nullopt;
  return maps::rotation_angle_rad(before->linear().transpose() * after->linear()) /
         (1e-9 * static_cast<double>(kRateNs));
}

/// Sums of squared differences of the rates, by offset.
using Misfits = std::array<double, kOffsets>;

/// The offset of the least misfit; nothing where that is at an end.
std::optional<double> least_of(const Misfits& misfits) {
  int best = 0;
  for (int k = 1; k < kOffsets; ++k)
    if (misfits[static_cast<std::size_t>(k)] < misfits[static_cast<std::size_t>(best)]) best = k;
  if (best == 0 || best + 1 == kOffsets) return std::nullopt;
  const double before = misfits[static_cast<std::size_t>(best) - 1];
  const double at = misfits[static_cast<std::size_t>(best)];
  const double after = misfits[static_cast<std::size_t>(best) + 1];
  const double bend = before - 2.0 * at + after;
  const double shift = bend > 0.0 ? 0.5 * (before - after) / bend : 0.0;
  return kOffsetStepS * (best + shift) - kMostOffsetS;
}

}  // namespace

ClockOffset clock_offset(const FollowedLidar& reference, const FollowedLidar& lidar) {
  std::array<Misfits, kParts> parts{};
  const auto& poses = lidar.path.poses();
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const auto rate = rate_at(lidar.path, poses[i].stamp_ns);
    if (!rate) continue;
    Misfits misfits{};
    bool all = true;
    for (int k = 0; k < kOffsets && all; ++k) {
      const double offset_s = kOffsetStepS * k - kMostOffsetS;
      const auto other = rate_at(reference.path, poses[i].stamp_ns + std::llround(1e9 * offset_s));
      all = other.has_value();
      if (all) misfits[static_cast<std::size_t>(k)] = (*rate - *other) * (*rate - *other);
    }
    if (!all) continue;
    Misfits& part = parts[i * kParts / poses.size()];
    for (std::size_t k = 0; k < misfits.size(); ++k) part[k] += misfits[k];
  }
  const auto sum_without = [&](std::size_t left_out) {
    Misfits sum{};
    for (std::size_t part = 0; part < kParts; ++part)
      for (std::size_t k = 0; k < sum.size(); ++k)
        sum[k] += part == left_out ? 0.0 : parts[part][k];
    return sum;
  };
  const std::optional<double> all = least_of(sum_without(kParts));
  if (!all) return {0.0, kMostOffsetS};
  double squares = 0.0;
  for (std::size_t part = 0; part < kParts; ++part) {
    const std::optional<double> without = least_of(sum_without(part));
    if (!without) return {0.0, kMostOffsetS};
    squares += (*without - *all) * (*without - *all);
  }
  return {*all, std::sqrt(squares * (kParts - 1.0) / kParts)};
}

}  // namespace stillmap::mapping
