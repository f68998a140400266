#include "detection/onnx/dense_decoding.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

namespace stillmap::mapping {

namespace {

/// Of the log of a size: 0.7 cm to 148 m, as CenterPoint's decoder has it.
constexpr double kMostLogEdge = 5.0;

struct Peak {
  std::size_t cell = 0;
  std::size_t head_class = 0;
  double score = 0.0;
};

struct HeadGrid {
  explicit HeadGrid(const OnnxConfig& config)
      : rows(static_cast<std::size_t>(config.rows / config.stride)),
        columns(static_cast<std::size_t>(config.columns / config.stride)),
        cells(rows * columns) {}
  std::size_t rows, columns, cells;
};

/// Whether no neighbour has more; NaN has not.
bool is_peak(const HeadGrid& grid, std::span<const float> heat, std::size_t cell) {
  const std::size_t row = cell / grid.columns, column = cell % grid.columns;
  for (std::size_t r = row == 0 ? 0 : row - 1; r <= std::min(row + 1, grid.rows - 1); ++r)
    for (std::size_t c = column == 0 ? 0 : column - 1; c <= std::min(column + 1, grid.columns - 1);
         ++c)
      if (heat[r * grid.columns + c] > heat[cell]) return false;
  return true;
}

double score_of(const OnnxConfig& config, const OnnxHead& head, double value) {
  if (config.scores_are_logits) return 1.0 / (1.0 + std::exp(-value));
  if (value < 0.0 || value > 1.0)
    throw maps::InputError(config.model.string(),
                           "the score " + std::to_string(value) + " in '" + head.heat_map + "'",
                           "scores in [0, 1], or \"scores\": \"logits\" in " + config.name);
  return value;
}

std::vector<Peak> candidates_of(const OnnxConfig& config, const OnnxHead& head,
                                const HeadGrid& grid, std::span<const float> heat_map) {
  std::vector<Peak> out;
  for (std::size_t c = 0; c < head.classes.size(); ++c) {
    if (!head.classes[c]) continue;
    const std::span<const float> heat = heat_map.subspan(c * grid.cells, grid.cells);
    for (std::size_t cell = 0; cell < grid.cells; ++cell) {
      const double score = score_of(config, head, static_cast<double>(heat[cell]));
      if (!(score >= config.score_threshold)) continue;
      if (!config.peaks_only || is_peak(grid, heat, cell)) out.push_back({cell, c, score});
    }
  }
  const auto by_place = [](const Peak& a, const Peak& b) {
    return a.cell != b.cell ? a.cell < b.cell : a.head_class < b.head_class;
  };
  if (out.size() > kMostBoxesOfHead) {
    std::nth_element(out.begin(), out.begin() + kMostBoxesOfHead, out.end(),
                     [&](const Peak& a, const Peak& b) {
                       return a.score != b.score ? a.score > b.score : by_place(a, b);
                     });
    out.resize(kMostBoxesOfHead);
  }
  std::sort(out.begin(), out.end(), by_place);
  return out;
}

std::optional<maps::Box> decode(const OnnxConfig& config, const HeadGrid& grid,
                                const HeadOutputs& outputs, std::size_t cell,
                                const NetworkHeight& z) {
  const auto value = [&](std::span<const float> tensor, std::size_t channel) {
    return static_cast<double>(tensor[channel * grid.cells + cell]);
  };
  const auto along = [&](std::size_t axis, std::size_t index) {
    return (static_cast<double>(index) + value(outputs.offset, axis)) * config.stride *
               config.cell_m[axis] +
           config.range_m[axis];
  };
  maps::Box box;
  const double x = along(0, cell % grid.columns), y = along(1, cell / grid.columns);
  for (Eigen::Index k = 0; k < 3; ++k) {
    const double size = value(outputs.size, static_cast<std::size_t>(k));
    box.size_m[k] =
        config.sizes_are_logs ? std::exp(std::clamp(size, -kMostLogEdge, kMostLogEdge)) : size;
  }
  const double first = value(outputs.rotation, 0), second = value(outputs.rotation, 1);
  box.yaw_rad = config.cosine_first ? std::atan2(second, first) : std::atan2(first, second);
  if (!std::isfinite(x) || !std::isfinite(y)) return std::nullopt;
  const std::optional<double> zero = z.zero_at(x, y);
  if (!zero) return std::nullopt;
  box.centre = {x, y, value(outputs.height, 0) + *zero};
  if (!box.centre.allFinite() || !box.size_m.allFinite() || !(box.size_m.minCoeff() > 0.0) ||
      !std::isfinite(box.yaw_rad))
    return std::nullopt;
  return box;
}

}  // namespace

std::vector<maps::Box> decode_dense(const OnnxConfig& config, const OnnxHead& head,
                                    const HeadOutputs& outputs, const NetworkHeight& z) {
  const HeadGrid grid(config);
  std::vector<maps::Box> boxes;
  for (const Peak& candidate : candidates_of(config, head, grid, outputs.heat_map)) {
    std::optional<maps::Box> box = decode(config, grid, outputs, candidate.cell, z);
    if (!box) continue;
    box->score = candidate.score;
    box->object_class = *head.classes[candidate.head_class];
    boxes.push_back(*box);
  }
  return boxes;
}

}  // namespace stillmap::mapping
