#include "odometry/loam/features.hpp"

#include <stillmap/maps/cell_table.hpp>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap::mapping::loam {
namespace {

/// Points of larger c may be edges, of smaller c planes. A right angle seen by an HDL-64E has
/// 0.007; 2 cm of noise at 10 m make 0.002.
constexpr float kMinEdgeSmoothness = 5e-3F;
constexpr float kMaxPlaneSmoothness = 3e-3F;
/// Two neighbours lie on different surfaces when their ranges differ by more than this [m] and
/// share of the range, or when the beams between them did not come back.
constexpr float kGapM = 0.3F;
constexpr float kGapShare = 0.02F;
/// Cosine of the paper's 10 degrees between surface and beam.
constexpr float kParallelCosine = 0.985F;
/// S of an edge that lies on one surface bends: the point is off the chord of S by this share of it
/// (a right angle: half). Eq. (1) alone also takes a smooth wall for edges where it runs away from
/// the sensor and points grow sparse, at the same place of every sweep, as if nothing moved.
constexpr float kMinBend = 0.1F;
constexpr float kEndSteps = 3.0F;
/// Smooth points of a ring are kept so far apart [m].
constexpr float kSmoothSpacingM = 0.3F;

/// A ring's points with what the selection has found out about them.
struct Ring {
  std::vector<Eigen::Vector3f> positions;
  std::vector<float> c;
  std::vector<std::uint8_t> usable;
  /// Of a selected feature, or one of the five points on either side of it.
  std::vector<std::uint8_t> taken;
};

bool gap_between(const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
  const float ra = a.norm();
  const float rb = b.norm();
  return std::abs(ra - rb) > kGapM + kGapShare * std::min(ra, rb);
}

void take(Ring& ring, std::size_t i) {
  const std::size_t end = std::min(i + kNeighbours + 1, ring.taken.size());
  for (std::size_t k = i - std::min(i, kNeighbours); k < end; ++k) ring.taken[k] = 1;
}

/// An end of a surface, or a bend of it. A step that ends a surface stands out of those beside it.
bool is_edge(const std::vector<Eigen::Vector3f>& ring, std::size_t i) {
  const auto step = [&](std::size_t k) { return (ring[k + 1] - ring[k]).norm(); };
  for (std::size_t k = i - kNeighbours; k < i + kNeighbours; ++k) {
    if (!gap_between(ring[k], ring[k + 1])) continue;
    const float before = k > 0 ? step(k - 1) : INFINITY;
    const float after = k + 2 < ring.size() ? step(k + 1) : INFINITY;
    if (step(k) > kEndSteps * std::min(before, after)) return true;
  }
  const Eigen::Vector3f chord = ring[i + kNeighbours] - ring[i - kNeighbours];
  const Eigen::Vector3f off = ring[i] - ring[i - kNeighbours];
  return off.cross(chord).norm() > kMinBend * chord.squaredNorm();
}

/// Positions [first, end) of the ring that c is known of, by rising c.
std::vector<std::uint32_t> by_smoothness(const Ring& ring, std::size_t first, std::size_t end) {
  std::vector<std::uint32_t> order;
  order.reserve(end - first);
  for (std::size_t i = first; i < end; ++i) {
    if (ring.usable[i] != 0) order.push_back(static_cast<std::uint32_t>(i));
  }
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return ring.c[a] < ring.c[b] || (ring.c[a] == ring.c[b] && a < b);
  });
  return order;
}

/// Positions in the ring; edges are less sharp ones too.
struct Selection {
  std::vector<std::uint32_t> edges, less_sharp, planes;
};
/// Edges from the largest c, planes from the smallest, until a sector has its number.
void select_in_sector(Ring& ring, std::size_t first, std::size_t end, Selection& selection) {
  const std::vector<std::uint32_t> order = by_smoothness(ring, first, end);
  std::size_t found = 0;
  for (auto it = order.rbegin(); it != order.rend() && found < kLessSharpPerSector; ++it) {
    if (!(ring.c[*it] > kMinEdgeSmoothness)) break;
    if (ring.taken[*it] != 0 || !is_edge(ring.positions, *it)) continue;
    if (found++ < kEdgesPerSector) selection.edges.push_back(*it);
    selection.less_sharp.push_back(*it);
    take(ring, *it);
  }
  found = 0;
  for (auto it = order.begin(); it != order.end() && found < kPlanesPerSector; ++it) {
    if (!(ring.c[*it] < kMaxPlaneSmoothness)) break;
    if (ring.taken[*it] != 0) continue;
    selection.planes.push_back(*it);
    take(ring, *it);
    ++found;
  }
}

/// Smooth points, thinned along the ring.
std::vector<std::uint32_t> smooth_points(const Ring& ring) {
  std::vector<std::uint32_t> out;
  for (std::size_t i = 0; i < ring.positions.size(); ++i) {
    if (ring.usable[i] == 0 || !(ring.c[i] < kMaxPlaneSmoothness)) continue;
    if (!out.empty() && (ring.positions[i] - ring.positions[out.back()]).squaredNorm() <
                            kSmoothSpacingM * kSmoothSpacingM) {
      continue;
    }
    out.push_back(static_cast<std::uint32_t>(i));
  }
  return out;
}

Ring prepared_ring(const maps::PointCloud& cloud, std::span<const std::uint32_t> points) {
  Ring ring;
  ring.positions.reserve(points.size());
  for (const std::uint32_t i : points) ring.positions.push_back(cloud.positions[i]);
  ring.c = smoothness(ring.positions);
  ring.usable = reliable(ring.positions);
  ring.taken.assign(points.size(), 0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!std::isfinite(ring.c[i])) ring.usable[i] = 0;
  }
  return ring;
}

}  // namespace

std::vector<float> smoothness(std::span<const Eigen::Vector3f> ring) {
  std::vector<float> c(ring.size(), std::numeric_limits<float>::quiet_NaN());
  constexpr auto kCount = static_cast<float>(2 * kNeighbours);
  for (std::size_t i = kNeighbours; i + kNeighbours < ring.size(); ++i) {
    Eigen::Vector3f sum = kCount * ring[i];
    for (std::size_t k = 1; k <= kNeighbours; ++k) sum -= ring[i - k] + ring[i + k];
    c[i] = sum.norm() / (kCount * ring[i].norm());
  }
  return c;
}

std::vector<std::uint8_t> reliable(std::span<const Eigen::Vector3f> ring) {
  const std::size_t n = ring.size();
  std::vector<std::uint8_t> gap(n, 1), out(n, 0);
  std::vector<float> range(n);
  for (std::size_t i = 0; i < n; ++i) range[i] = ring[i].norm();
  for (std::size_t i = 0; i + 1 < n; ++i) gap[i] = gap_between(ring[i], ring[i + 1]) ? 1 : 0;
  for (std::size_t i = 0; i < n; ++i) {
    // The surface that the point lies on, as far as S goes.
    std::size_t left = i;
    std::size_t right = i;
    while (left > 0 && i - left < kNeighbours && gap[left - 1] == 0) --left;
    while (right + 1 < n && right - i < kNeighbours && gap[right] == 0) ++right;
    const bool hidden_left = left > 0 && i - left < kNeighbours && range[left - 1] < range[left];
    const bool hidden_right =
        right + 1 < n && right - i < kNeighbours && range[right + 1] < range[right];
    if (hidden_left || hidden_right || left == right) continue;
    const Eigen::Vector3f chord = ring[right] - ring[left];
    const float along = std::abs(chord.dot(ring[i]));
    out[i] = along < kParallelCosine * chord.norm() * range[i] ? 1 : 0;
  }
  return out;
}

Features find_features(const maps::PointCloud& cloud, const Rings& rings) {
  Features features;
  for (std::size_t r = 0; r < rings.size(); ++r) {
    const auto points = rings.ring(r);
    if (points.size() <= 2 * kNeighbours) continue;
    Ring ring = prepared_ring(cloud, points);
    Selection selection;
    const std::size_t known = points.size() - 2 * kNeighbours;
    for (std::size_t s = 0; s < kSectors; ++s) {
      select_in_sector(ring, kNeighbours + known * s / kSectors,
                       kNeighbours + known * (s + 1) / kSectors, selection);
    }
    const auto append = [&](std::vector<std::uint32_t>& from, std::vector<Feature>& to) {
      std::sort(from.begin(), from.end());
      for (const std::uint32_t i : from) {
        const std::uint32_t p = points[i];
        const float time_s = cloud.time_offsets_s.empty() ? 0.0F : cloud.time_offsets_s[p];
        to.push_back({cloud.positions[p], time_s, static_cast<std::uint32_t>(r), false});
      }
    };
    append(selection.edges, features.edges);
    append(selection.less_sharp, features.less_sharp);
    append(selection.planes, features.planes);
    std::vector<std::uint32_t> smooth = smooth_points(ring);
    append(smooth, features.less_flat);
  }
  return features;
}

void turn_to_stamp(Features& features, const maps::SweepTurn* turn) {
  if (turn == nullptr) return;
  for (std::vector<Feature>* all :
       {&features.edges, &features.planes, &features.less_sharp, &features.less_flat}) {
    for (Feature& feature : *all) {
      feature.position = turn->at(feature.time_s) * feature.position;
      feature.is_turned = true;
    }
  }
}

std::vector<Feature> thinned(const std::vector<Feature>& features, double voxel_m) {
  maps::CellTable taken(features.size() / 2);
  std::vector<Feature> out;
  for (const Feature& feature : features) {
    const Eigen::Array3i voxel =
        (feature.position / static_cast<float>(voxel_m)).array().floor().cast<int>();
    if (taken.insert(maps::signed_cell_key(voxel.x(), voxel.y(), voxel.z())).second)
      out.push_back(feature);
  }
  return out;
}

}  // namespace stillmap::mapping::loam
