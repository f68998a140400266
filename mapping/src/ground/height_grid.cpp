#include "ground/height_grid.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr std::array<std::array<int, 2>, 8> kNeighbours = {
    {{-1, -1}, {0, -1}, {1, -1}, {-1, 0}, {1, 0}, {-1, 1}, {0, 1}, {1, 1}}};

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

std::optional<GroundSurface::Sample> HeightGrid::at(double x, double y) const {
  if (!(std::abs(x) < kHalfSideM && std::abs(y) < kHalfSideM)) return std::nullopt;
  const double u = (x + kHalfSideM) / kCellM - 0.5;
  const double v = (y + kHalfSideM) / kCellM - 0.5;
  const int ix = static_cast<int>(std::floor(u));
  const int iy = static_cast<int>(std::floor(v));
  const double fx = u - ix;
  const double fy = v - iy;
  double weight = 0.0;
  double z = 0.0;
  double slope_x = 0.0;
  double slope_y = 0.0;
  double confidence = 0.0;
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
    z += w * (n.z + n.slope_x * dx + n.slope_y * dy);
    slope_x += w * n.slope_x;
    slope_y += w * n.slope_y;
    confidence += w * n.confidence;
  }
  if (!(weight > 1e-3)) return std::nullopt;
  Sample sample;
  sample.z = z / weight;
  sample.normal = Eigen::Vector3d(-slope_x / weight, -slope_y / weight, 1.0).normalized();
  sample.confidence = std::min(1.0, confidence / weight);
  return sample;
}

void HeightGrid::dilate(float confidence) {
  std::vector<std::pair<int, Node>> fresh;
  for (int iy = 1; iy + 1 < kCellsPerSide; ++iy) {
    for (int ix = 1; ix + 1 < kCellsPerSide; ++ix) {
      const int index = iy * kCellsPerSide + ix;
      if (node(index).confidence > 0.0F) continue;
      Node sum;
      float known = 0.0F;
      for (const auto& [dx, dy] : kNeighbours) {
        const Node& n = node(index + dy * kCellsPerSide + dx);
        if (n.confidence <= 0.0F) continue;
        known += 1.0F;
        sum.z += n.z - n.slope_x * static_cast<float>(dx) - n.slope_y * static_cast<float>(dy);
        sum.slope_x += n.slope_x;
        sum.slope_y += n.slope_y;
      }
      if (known == 0.0F) continue;
      fresh.emplace_back(index,
                         Node{sum.z / known, sum.slope_x / known, sum.slope_y / known, confidence});
    }
  }
  for (const auto& [index, n] : fresh) node(index) = n;
}

void HeightGrid::iron_filled() {
  std::vector<Node> ironed = nodes_;
  for (int iy = 1; iy + 1 < kCellsPerSide; ++iy) {
    for (int ix = 1; ix + 1 < kCellsPerSide; ++ix) {
      const int index = iy * kCellsPerSide + ix;
      const float confidence = node(index).confidence;
      if (confidence <= 0.0F || confidence >= 1.0F) continue;
      Node sum{0.0F, 0.0F, 0.0F, confidence};
      bool enclosed = true;
      for (const auto& [dx, dy] : kNeighbours) {
        const Node& n = node(index + dy * kCellsPerSide + dx);
        enclosed = enclosed && n.confidence > 0.0F;
        sum.z += 0.125F * n.z;
        sum.slope_x += 0.125F * n.slope_x;
        sum.slope_y += 0.125F * n.slope_y;
      }
      if (enclosed) ironed[static_cast<std::size_t>(index)] = sum;
    }
  }
  nodes_ = std::move(ironed);
}

void HeightGrid::fill(int reach) {
  for (int step = 1; step <= reach; ++step) {
    dilate(1.0F - static_cast<float>(step) / static_cast<float>(reach + 1));
  }
  // Fronts of different sides meet in a step; ironing spreads it over the gap.
  for (int pass = 0; pass < 4; ++pass) iron_filled();
}

void HeightGrid::tilt(const SeedPlane& plane) {
  for (int index = 0; index < kCellsPerSide * kCellsPerSide; ++index) {
    Node& n = node(index);
    n.z += static_cast<float>(plane.z_at(centre_x(index), centre_y(index)));
    n.slope_x += static_cast<float>(plane.slope.x());
    n.slope_y += static_cast<float>(plane.slope.y());
  }
}

}  // namespace stillmap::mapping
