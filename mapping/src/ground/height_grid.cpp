#include "ground/height_grid.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr std::array<std::array<int, 2>, 8> kNeighbours = {
    {{-1, -1}, {0, -1}, {1, -1}, {-1, 0}, {1, 0}, {-1, 1}, {0, 1}, {1, 1}}};

constexpr double kLeastWeight = 1e-3;

}  // namespace

int HeightGrid::index_of(float x, float y) {
  constexpr auto kHalf = static_cast<float>(kHalfSideM);
  if (!(x >= -kHalf && x < kHalf && y >= -kHalf && y < kHalf)) return -1;
  constexpr auto kPerMetre = static_cast<float>(1.0 / kCellM);
  // The clamp meets the last float below the border, which the sum rounds up to it.
  const int ix = std::min(static_cast<int>((x + kHalf) * kPerMetre), kCellsPerSide - 1);
  const int iy = std::min(static_cast<int>((y + kHalf) * kPerMetre), kCellsPerSide - 1);
  return iy * kCellsPerSide + ix;
}

/// Calls `add(node, height there, weight)` for each known node around a place.
/// @return the sum of the weights; 0 outside of the grid.
template <typename Add>
double HeightGrid::for_nodes_around(double x, double y, const Add& add) const {
  if (!(std::abs(x) < kHalfSideM && std::abs(y) < kHalfSideM)) return 0.0;
  const double u = (x + kHalfSideM) / kCellM - 0.5;
  const double v = (y + kHalfSideM) / kCellM - 0.5;
  // Both are above -1.
  const int ix = static_cast<int>(u + 1.0) - 1;
  const int iy = static_cast<int>(v + 1.0) - 1;
  const double fx = u - ix;
  const double fy = v - iy;
  double weight = 0.0;
  for (int corner = 0; corner < 4; ++corner) {
    const int cx = ix + (corner & 1);
    const int cy = iy + (corner >> 1);
    if (cx < 0 || cy < 0 || cx >= kCellsPerSide || cy >= kCellsPerSide) continue;
    const Node& n = node(cy * kCellsPerSide + cx);
    if (n.confidence <= 0.0F) continue;
    const double dx = (fx - (corner & 1)) * kCellM;
    const double dy = (fy - (corner >> 1)) * kCellM;
    // Never quite zero: a lone known node carries its whole cell.
    const double w = (1.0 - std::abs(dx) / kCellM) * (1.0 - std::abs(dy) / kCellM) + 1e-6;
    weight += w;
    add(n, n.z + n.slope_x * dx + n.slope_y * dy, w);
  }
  return weight;
}

std::optional<GroundSurface::Sample> HeightGrid::at(double x, double y) const {
  double z = 0.0, slope_x = 0.0, slope_y = 0.0, confidence = 0.0;
  const double weight = for_nodes_around(x, y, [&](const Node& n, double height, double w) {
    z += w * height;
    slope_x += w * n.slope_x;
    slope_y += w * n.slope_y;
    confidence += w * n.confidence;
  });
  if (!(weight > kLeastWeight)) return std::nullopt;
  Sample sample;
  sample.z = z / weight;
  sample.normal = Eigen::Vector3d(-slope_x / weight, -slope_y / weight, 1.0).normalized();
  sample.confidence = std::min(1.0, confidence / weight);
  return sample;
}

std::optional<double> HeightGrid::z_at(double x, double y) const {
  double z = 0.0;
  const double weight =
      for_nodes_around(x, y, [&](const Node&, double height, double w) { z += w * height; });
  return weight > kLeastWeight ? std::optional(z / weight) : std::nullopt;
}

std::vector<int> HeightGrid::unknown_beside(const std::vector<int>& cells) const {
  std::vector<int> found;
  std::vector<bool> seen(nodes_.size(), false);
  for (const int cell : cells) {
    for (const auto& [dx, dy] : kNeighbours) {
      const int x = cell % kCellsPerSide + dx;
      const int y = cell / kCellsPerSide + dy;
      // The outermost cells stay as they are: they lack neighbours to be filled from.
      if (x < 1 || y < 1 || x > kCellsPerSide - 2 || y > kCellsPerSide - 2) continue;
      const int other = y * kCellsPerSide + x;
      if (node(other).confidence > 0.0F || seen[static_cast<std::size_t>(other)]) continue;
      seen[static_cast<std::size_t>(other)] = true;
      found.push_back(other);
    }
  }
  return found;
}

HeightGrid::Node HeightGrid::from_neighbours(int cell, float confidence) const {
  Node sum;
  float known = 0.0F;
  for (const auto& [dx, dy] : kNeighbours) {
    const Node& n = node(cell + dy * kCellsPerSide + dx);
    if (n.confidence <= 0.0F) continue;
    known += 1.0F;
    sum.z += n.z - n.slope_x * static_cast<float>(dx) - n.slope_y * static_cast<float>(dy);
    sum.slope_x += n.slope_x;
    sum.slope_y += n.slope_y;
  }
  return {sum.z / known, sum.slope_x / known, sum.slope_y / known, confidence};
}

void HeightGrid::iron(const std::vector<int>& cells) {
  std::vector<Node> ironed;
  ironed.reserve(cells.size());
  for (const int cell : cells) {
    Node sum{0.0F, 0.0F, 0.0F, node(cell).confidence};
    bool enclosed = true;
    for (const auto& [dx, dy] : kNeighbours) {
      const Node& n = node(cell + dy * kCellsPerSide + dx);
      enclosed = enclosed && n.confidence > 0.0F;
      sum.z += 0.125F * n.z;
      sum.slope_x += 0.125F * n.slope_x;
      sum.slope_y += 0.125F * n.slope_y;
    }
    ironed.push_back(enclosed ? sum : node(cell));
  }
  for (std::size_t i = 0; i < cells.size(); ++i) node(cells[i]) = ironed[i];
}

void HeightGrid::fill(int reach) {
  std::vector<int> front;
  for (int cell = 0; cell < kCellsPerSide * kCellsPerSide; ++cell) {
    if (node(cell).confidence > 0.0F) front.push_back(cell);
  }
  std::vector<int> filled;
  for (int step = 1; step <= reach; ++step) {
    const float confidence = 1.0F - static_cast<float>(step) / static_cast<float>(reach + 1);
    front = unknown_beside(front);
    std::vector<Node> fresh;
    fresh.reserve(front.size());
    for (const int cell : front) fresh.push_back(from_neighbours(cell, confidence));
    for (std::size_t i = 0; i < front.size(); ++i) node(front[i]) = fresh[i];
    filled.insert(filled.end(), front.begin(), front.end());
  }
  // Fronts of different sides meet in a step; ironing spreads it over the gap.
  for (int pass = 0; pass < 4; ++pass) iron(filled);
}

float HeightGrid::height_at(float x, float y) const {
  const float u = x + static_cast<float>(kHalfSideM) - 0.5F;
  const float v = y + static_cast<float>(kHalfSideM) - 0.5F;
  const int ix = static_cast<int>(std::floor(u));
  const int iy = static_cast<int>(std::floor(v));
  const float fx = u - static_cast<float>(ix), fy = v - static_cast<float>(iy);
  float weight = 0.0F, z = 0.0F;
  for (int corner = 0; corner < 4; ++corner) {
    const int cx = ix + (corner & 1), cy = iy + (corner >> 1);
    if (cx < 0 || cy < 0 || cx >= kCellsPerSide || cy >= kCellsPerSide) continue;
    const Node& n = node(cy * kCellsPerSide + cx);
    if (n.confidence <= 0.0F) continue;
    const float dx = fx - static_cast<float>(corner & 1), dy = fy - static_cast<float>(corner >> 1);
    const float w = (1.0F - std::abs(dx)) * (1.0F - std::abs(dy)) + 1e-6F;
    weight += w;
    z += w * (n.z + n.slope_x * dx + n.slope_y * dy);
  }
  return z / weight;
}

void HeightGrid::tilt(const SeedPlane& plane) {
  for (int index = 0; index < kCellsPerSide * kCellsPerSide; ++index) {
    Node& n = node(index);
    if (n.confidence <= 0.0F) continue;
    n.z += static_cast<float>(plane.z_at(centre_x(index), centre_y(index)));
    n.slope_x += static_cast<float>(plane.slope.x());
    n.slope_y += static_cast<float>(plane.slope.y());
  }
}

}  // namespace stillmap::mapping
