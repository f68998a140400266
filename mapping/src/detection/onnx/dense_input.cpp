#include "detection/onnx/dense_input.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

namespace stillmap::mapping {

namespace {

struct GridPoint {
  /// row * columns + column
  std::size_t cell = 0;
  double x = 0.0, y = 0.0, z = 0.0, intensity = 0.0;
};

/// Index of the cell along an axis, none outside; NaN is outside.
std::optional<int> cell_of(const OnnxConfig& config, std::size_t axis, int cells, double value) {
  const double low = config.range_m[axis];
  if (!(value >= low && value < config.range_m[axis + 3])) return std::nullopt;
  return std::min(static_cast<int>((value - low) / config.cell_m[axis]), cells - 1);
}

/// Points in the range, in the order of the scan.
std::vector<GridPoint> points_in_range(const OnnxConfig& config, const maps::PointCloud& cloud,
                                       const NetworkHeight& z) {
  std::vector<GridPoint> out;
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    const Eigen::Vector3d p = cloud.positions[k].cast<double>();
    const auto column = cell_of(config, 0, config.columns, p.x());
    const auto row = cell_of(config, 1, config.rows, p.y());
    if (!column || !row) continue;
    const std::optional<double> zero = z.zero_at(p.x(), p.y());
    if (!zero) continue;
    const double height = p.z() - *zero;
    if (!(height >= config.range_m[2] && height < config.range_m[5])) continue;
    const auto cell = static_cast<std::size_t>(*row) * static_cast<std::size_t>(config.columns) +
                      static_cast<std::size_t>(*column);
    const double intensity =
        cloud.intensities.empty() ? 0.0 : static_cast<double>(cloud.intensities[k]);
    out.push_back({cell, p.x(), p.y(), height, intensity});
  }
  return out;
}

struct CellSums {
  double count = 0.0, z = 0.0, intensity = 0.0;
  double max_z = -std::numeric_limits<double>::infinity();
};

float channel_of(BevChannel channel, const CellSums& sums) {
  switch (channel) {
    case BevChannel::kMaxZ:
      return static_cast<float>(sums.max_z);
    case BevChannel::kMeanZ:
      return static_cast<float>(sums.z / sums.count);
    case BevChannel::kLogCount:
      return static_cast<float>(std::log1p(sums.count));
    case BevChannel::kMeanIntensity:
      return static_cast<float>(sums.intensity / sums.count);
  }
  return 0.0F;
}

/// What the features of a pillar's points refer to.
struct PillarFrame {
  double mean_x = 0.0, mean_y = 0.0, mean_z = 0.0;
  double centre_x = 0.0, centre_y = 0.0;
};

float feature_of(PillarFeature feature, const GridPoint& p, const PillarFrame& frame) {
  switch (feature) {
    case PillarFeature::kX:
      return static_cast<float>(p.x);
    case PillarFeature::kY:
      return static_cast<float>(p.y);
    case PillarFeature::kZ:
      return static_cast<float>(p.z);
    case PillarFeature::kIntensity:
      return static_cast<float>(p.intensity);
    case PillarFeature::kMeanDx:
      return static_cast<float>(p.x - frame.mean_x);
    case PillarFeature::kMeanDy:
      return static_cast<float>(p.y - frame.mean_y);
    case PillarFeature::kMeanDz:
      return static_cast<float>(p.z - frame.mean_z);
    case PillarFeature::kCentreDx:
      return static_cast<float>(p.x - frame.centre_x);
    case PillarFeature::kCentreDy:
      return static_cast<float>(p.y - frame.centre_y);
  }
  return 0.0F;
}

/// @param points  of one cell, at least one.
PillarFrame frame_of(const OnnxConfig& config, const std::vector<const GridPoint*>& points) {
  PillarFrame frame;
  for (const GridPoint* p : points) {
    frame.mean_x += p->x;
    frame.mean_y += p->y;
    frame.mean_z += p->z;
  }
  for (double* mean : {&frame.mean_x, &frame.mean_y, &frame.mean_z})
    *mean /= static_cast<double>(points.size());
  const auto columns = static_cast<std::size_t>(config.columns);
  const std::size_t cell = points.front()->cell;
  frame.centre_x =
      config.range_m[0] + (static_cast<double>(cell % columns) + 0.5) * config.cell_m[0];
  frame.centre_y =
      config.range_m[1] + (static_cast<double>(cell / columns) + 0.5) * config.cell_m[1];
  return frame;
}

/// Points of each cell that has some, ascending by cell, at most `most_points` each.
std::vector<std::vector<const GridPoint*>> pillars_of(const std::vector<GridPoint>& points,
                                                      std::size_t most_points) {
  std::vector<const GridPoint*> order(points.size());
  std::transform(points.begin(), points.end(), order.begin(),
                 [](const GridPoint& p) { return &p; });
  std::stable_sort(order.begin(), order.end(),
                   [](const GridPoint* a, const GridPoint* b) { return a->cell < b->cell; });
  std::vector<std::vector<const GridPoint*>> pillars;
  for (const GridPoint* p : order) {
    if (pillars.empty() || pillars.back().front()->cell != p->cell) pillars.emplace_back();
    if (pillars.back().size() < most_points) pillars.back().push_back(p);
  }
  return pillars;
}

}  // namespace

OnnxTensor bev_tensor(const OnnxConfig& config, const maps::PointCloud& cloud,
                      const NetworkHeight& z) {
  const auto cells =
      static_cast<std::size_t>(config.rows) * static_cast<std::size_t>(config.columns);
  std::vector<CellSums> sums(cells);
  for (const GridPoint& p : points_in_range(config, cloud, z)) {
    CellSums& cell = sums[p.cell];
    cell.count += 1.0;
    cell.z += p.z;
    cell.intensity += p.intensity;
    cell.max_z = std::max(cell.max_z, p.z);
  }
  const std::vector<BevChannel>& channels = config.bev->channels;
  std::vector<float> values(channels.size() * cells, 0.0F);
  for (std::size_t c = 0; c < channels.size(); ++c)
    for (std::size_t cell = 0; cell < cells; ++cell)
      if (sums[cell].count > 0.0) values[c * cells + cell] = channel_of(channels[c], sums[cell]);
  return {config.bev->tensor,
          {1, static_cast<std::int64_t>(channels.size()), config.rows, config.columns},
          std::move(values)};
}

Pillars pillar_tensors(const OnnxConfig& config, const maps::PointCloud& cloud,
                       const NetworkHeight& z) {
  const PillarInput& input = *config.pillars;
  const std::vector<GridPoint> points = points_in_range(config, cloud, z);
  const auto most_points = static_cast<std::size_t>(input.most_points);
  const auto pillars = pillars_of(points, most_points);
  const std::size_t features = input.features.size();
  std::vector<float> values(pillars.size() * most_points * features, 0.0F);
  std::vector<std::int64_t> cells, counts;
  for (std::size_t i = 0; i < pillars.size(); ++i) {
    const PillarFrame frame = frame_of(config, pillars[i]);
    for (std::size_t k = 0; k < pillars[i].size(); ++k)
      for (std::size_t f = 0; f < features; ++f)
        values[(i * most_points + k) * features + f] =
            feature_of(input.features[f], *pillars[i][k], frame);
    const auto cell = static_cast<std::int64_t>(pillars[i].front()->cell);
    cells.insert(cells.end(), {0, 0, cell / config.columns, cell % config.columns});
    counts.push_back(static_cast<std::int64_t>(pillars[i].size()));
  }
  const auto count = static_cast<std::int64_t>(pillars.size());
  return {{input.points,
           {count, input.most_points, static_cast<std::int64_t>(features)},
           std::move(values)},
          {input.cells, {count, 4}, std::move(cells)},
          {input.counts, {count}, std::move(counts)}};
}

}  // namespace stillmap::mapping
