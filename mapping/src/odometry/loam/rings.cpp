#include "odometry/loam/rings.hpp"

#include "odometry/loam/ring_order.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace stillmap::mapping::loam {
namespace {

/// Fewer points tell nothing about the sensor.
constexpr std::size_t kMinPoints = 1000;
/// Fewer rings see no surface across them; more than any sensor has.
constexpr std::size_t kMinRings = 8;
constexpr std::size_t kMaxRings = 256;
constexpr double kBinRad = 0.04 * std::numbers::pi / 180.0;
/// A bin belongs to a ring when it holds this share of what a bin holds on average: between the
/// rings of a sensor that has some lies next to nothing.
constexpr double kRingBinShare = 0.5;
/// A run of bins is a ring when it takes at most this share of the way to the next one.
constexpr double kMaxWidthShare = 0.5;
/// Share of points that must lie in rings.
constexpr double kMinShareInRings = 0.9;

struct Directions {
  /// Positions in the cloud.
  std::vector<std::uint32_t> points;
  /// [rad], of the point at the same place in `points`.
  std::vector<float> azimuths, elevations;
};

Directions directions_of(const maps::PointCloud& cloud) {
  Directions out;
  out.points.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.positions[i];
    const float range = p.norm();
    if (!(range >= kMinRangeM && range <= kMaxRangeM)) continue;
    out.points.push_back(static_cast<std::uint32_t>(i));
    out.azimuths.push_back(std::atan2(p.y(), p.x()));
    out.elevations.push_back(std::asin(std::clamp(p.z() / range, -1.0F, 1.0F)));
  }
  return out;
}

/// Runs of full bins of the histogram, as [first, end) bins.
struct Run {
  std::size_t first = 0, end = 0;
  [[nodiscard]] double centre() const { return 0.5 * static_cast<double>(first + end); }
  [[nodiscard]] double width() const { return static_cast<double>(end - first); }
};

std::vector<Run> runs_of(const std::vector<std::uint32_t>& counts, double threshold) {
  std::vector<Run> runs;
  for (std::size_t b = 0; b < counts.size(); ++b) {
    if (!(counts[b] >= threshold)) continue;
    if (!runs.empty() && runs.back().end == b) {
      ++runs.back().end;
    } else {
      runs.push_back({b, b + 1});
    }
  }
  return runs;
}

/// Keeps the runs that are narrow beside the gap to both neighbours.
std::vector<Run> narrow(const std::vector<Run>& runs) {
  std::vector<Run> out;
  for (std::size_t k = 0; k < runs.size(); ++k) {
    double gap = INFINITY;
    if (k > 0) gap = std::min(gap, runs[k].centre() - runs[k - 1].centre());
    if (k + 1 < runs.size()) gap = std::min(gap, runs[k + 1].centre() - runs[k].centre());
    if (runs[k].width() <= std::max(2.0, kMaxWidthShare * gap)) out.push_back(runs[k]);
  }
  return out;
}

/// Rings as peaks of the histogram of elevations; none when there are no such peaks.
Rings rings_by_elevation(const Directions& d) {
  const auto [low, high] = std::minmax_element(d.elevations.begin(), d.elevations.end());
  const auto bin_of = [&](float e) { return static_cast<std::size_t>((e - *low) / kBinRad); };
  std::vector<std::uint32_t> counts(bin_of(*high) + 1, 0);
  for (const float e : d.elevations) ++counts[bin_of(e)];
  const double mean = static_cast<double>(d.points.size()) / static_cast<double>(counts.size());
  const std::vector<Run> runs = narrow(runs_of(counts, kRingBinShare * mean));
  if (runs.size() < kMinRings || runs.size() > kMaxRings) return {};

  std::vector<std::vector<std::uint32_t>> members(runs.size());
  std::size_t inside = 0;
  for (std::size_t i = 0; i < d.points.size(); ++i) {
    const double bin = (d.elevations[i] - *low) / kBinRad;
    const auto after = std::upper_bound(runs.begin(), runs.end(), bin, [](double b, const Run& r) {
      return b < static_cast<double>(r.first);
    });
    if (after == runs.begin() || !(bin < static_cast<double>((after - 1)->end))) continue;
    members[static_cast<std::size_t>(after - runs.begin()) - 1].push_back(
        static_cast<std::uint32_t>(i));
    ++inside;
  }
  if (static_cast<double>(inside) < kMinShareInRings * static_cast<double>(d.points.size())) {
    return {};
  }
  Rings rings;
  rings.starts.push_back(0);
  for (auto& ring : members) {
    std::stable_sort(ring.begin(), ring.end(), [&](std::uint32_t a, std::uint32_t b) {
      return d.azimuths[a] < d.azimuths[b];
    });
    for (const std::uint32_t i : ring) rings.points.push_back(d.points[i]);
    rings.starts.push_back(static_cast<std::uint32_t>(rings.points.size()));
  }
  return rings;
}

}  // namespace

Rings find_rings(const maps::Scan& scan) {
  const Directions d = directions_of(scan.cloud);
  if (d.points.size() < kMinPoints) return {};
  Rings rings;
  rings.starts = ring_starts_by_order(d.azimuths, d.elevations);
  if (rings.size() >= kMinRings && rings.size() <= kMaxRings) {
    rings.points = d.points;
    return rings;
  }
  rings = rings_by_elevation(d);
  if (rings.size() == 0) {
    throw maps::InputError(
        scan.source,
        fmt::format("{} points that lie on no rings, neither in their order nor by elevation",
                    d.points.size()),
        "a sensor that spins with 8 to 256 lasers, which loam needs (another odometry takes any)");
  }
  return rings;
}

}  // namespace stillmap::mapping::loam
