#include "detection/onnx/onnx_config.hpp"

#include <stillmap/maps/json_fields.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <string_view>
#include <utility>

namespace stillmap::mapping {

namespace {

using maps::JsonField;

/// Beyond a kilometre no LiDAR returns; a cell below 1 cm is finer than its noise.
constexpr double kFarthestM = 1000.0;
constexpr double kMinCell_m = 0.01;
constexpr double kMaxCell_m = 10.0;
/// Cells along an axis: four times what published networks of this kind have.
constexpr int kMaxCells = 4096;
constexpr int kMaxStride = 64;
constexpr std::size_t kMaxHeads = 64;
constexpr std::size_t kMaxClasses = 64;
constexpr int kMaxPointsOfPillar = 1024;
/// A description has some 2 KiB.
constexpr std::size_t kMaxBytes = std::size_t{1} << 20;

/// Name of a tensor: ONNX Runtime is given it as a C string.
std::string tensor_of(const JsonField& value) {
  std::string name = value.text();
  if (name.empty() || name.find('\0') != std::string::npos) value.refuse("the name of a tensor");
  return name;
}

/// Cells along an axis.
int cells_along(const JsonField& cell, double extent_m, double cell_m, int stride) {
  const double cells = std::round(extent_m / cell_m);
  // Ranges are written with a few decimals: 70.4 m are 352 cells of 0.2 m.
  const bool fits = std::abs(cells * cell_m - extent_m) <= 1e-6;
  if (!(fits && cells >= 1.0 && cells <= kMaxCells) || static_cast<int>(cells) % stride != 0)
    cell.refuse("a multiple of the stride " + std::to_string(stride) + ", up to " +
                std::to_string(kMaxCells) + ", of them in " + nlohmann::json(extent_m).dump() +
                " m");
  return static_cast<int>(cells);
}

void read_grid(const JsonField& root, OnnxConfig& config) {
  const auto range = root.at("range_m").elements(6, 6);
  for (std::size_t i = 0; i < 6; ++i) config.range_m[i] = range[i].number(-kFarthestM, kFarthestM);
  if (!(config.range_m[2] < config.range_m[5])) range[5].refuse("more than the least z");
  const auto cell = root.at("cell_m").elements(2, 2);
  config.stride = root.at("stride").whole(1, kMaxStride);
  std::array<int, 2> cells{};
  for (std::size_t i = 0; i < 2; ++i) {
    config.cell_m[i] = cell[i].number(kMinCell_m, kMaxCell_m);
    cells[i] = cells_along(cell[i], config.range_m[i + 3] - config.range_m[i], config.cell_m[i],
                           config.stride);
  }
  config.columns = cells[0];
  config.rows = cells[1];
  config.z = root.at("z").one_of<VoxelNextHeight>(
      {{"ground", VoxelNextHeight::kGround}, {"lidar", VoxelNextHeight::kLidar}});
  config.sensor_height_m = root.at("sensor_height_m").number(-10.0, 100.0);
}

BevInput read_bev(const JsonField& input) {
  input.exactly({"kind", "tensor", "channels"});
  return {tensor_of(input.at("tensor")),
          input.at("channels")
              .set_of<BevChannel>({{"max_z", BevChannel::kMaxZ},
                                   {"mean_z", BevChannel::kMeanZ},
                                   {"log_count", BevChannel::kLogCount},
                                   {"mean_intensity", BevChannel::kMeanIntensity}})};
}

PillarInput read_pillars(const JsonField& input) {
  input.exactly({"kind", "points", "cells", "counts", "features", "most_points"});
  return {tensor_of(input.at("points")), tensor_of(input.at("cells")),
          tensor_of(input.at("counts")),
          input.at("features")
              .set_of<PillarFeature>({{"x", PillarFeature::kX},
                                      {"y", PillarFeature::kY},
                                      {"z", PillarFeature::kZ},
                                      {"intensity", PillarFeature::kIntensity},
                                      {"mean_dx", PillarFeature::kMeanDx},
                                      {"mean_dy", PillarFeature::kMeanDy},
                                      {"mean_dz", PillarFeature::kMeanDz},
                                      {"centre_dx", PillarFeature::kCentreDx},
                                      {"centre_dy", PillarFeature::kCentreDy}}),
          input.at("most_points").whole(1, kMaxPointsOfPillar)};
}

OnnxHead read_head(const JsonField& value) {
  value.exactly({"classes", "heat_map", "offset", "height", "size", "rotation"});
  OnnxHead head;
  for (const JsonField& name : value.at("classes").elements(1, kMaxClasses)) {
    const std::string text = name.text();
    head.classes.push_back(maps::object_class_from(text));
    if (!text.empty() && !head.classes.back()) name.refuse("the name of an object class, or \"\"");
  }
  head.heat_map = tensor_of(value.at("heat_map"));
  head.offset = tensor_of(value.at("offset"));
  head.height = tensor_of(value.at("height"));
  head.size = tensor_of(value.at("size"));
  head.rotation = tensor_of(value.at("rotation"));
  return head;
}

}  // namespace

OnnxConfig read_onnx_config(const std::filesystem::path& file) {
  const std::string name = file.string();
  const nlohmann::json parsed = maps::parse_json(maps::read_text(file, kMaxBytes), name);
  const JsonField root(parsed, name, "config");
  root.exactly({"format", "version", "model", "range_m", "cell_m", "z", "sensor_height_m", "input",
                "stride", "scores", "sizes", "rotation", "heads", "score_threshold", "nms",
                "nms_iou"});
  if (root.at("format").text() != "stillmap-onnx") root.at("format").refuse("\"stillmap-onnx\"");
  if (root.at("version").whole(1, std::numeric_limits<int>::max()) != 1)
    root.at("version").refuse("1");
  OnnxConfig config;
  config.name = name;
  const std::filesystem::path model = tensor_of(root.at("model"));
  if (model != model.filename()) root.at("model").refuse("the name of a file beside this one");
  config.model = file.parent_path() / model;
  read_grid(root, config);
  const JsonField input = root.at("input");
  if (input.at("kind").one_of<bool>({{"bev", true}, {"pillars", false}}))
    config.bev = read_bev(input);
  else
    config.pillars = read_pillars(input);
  config.scores_are_logits = root.at("scores").one_of<bool>({{"logits", true}, {"scores", false}});
  config.sizes_are_logs = root.at("sizes").one_of<bool>({{"log", true}, {"metres", false}});
  config.cosine_first = root.at("rotation").one_of<bool>({{"cos_sin", true}, {"sin_cos", false}});
  for (const JsonField& head : root.at("heads").elements(1, kMaxHeads))
    config.heads.push_back(read_head(head));
  // At 0 every cell of the grid would be a box.
  config.score_threshold = root.at("score_threshold").number(0.001, 1.0);
  config.peaks_only = root.at("nms").one_of<bool>({{"maxpool", true}, {"rotated", false}});
  config.nms_iou = root.at("nms_iou").number(0.0, 1.0);
  return config;
}

}  // namespace stillmap::mapping
