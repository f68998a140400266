#include "detection/voxelnext/config_text.hpp"

#include <stillmap/maps/json_fields.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

namespace stillmap::mapping {
namespace {

using maps::JsonField;

template <typename Meaning>
using Names = std::initializer_list<std::pair<std::string_view, Meaning>>;

const Names<VoxelFeature> kFeatures = {
    {"x", VoxelFeature::kX},      {"y", VoxelFeature::kY},
    {"z", VoxelFeature::kZ},      {"intensity", VoxelFeature::kIntensity},
    {"dx", VoxelFeature::kDx},    {"dy", VoxelFeature::kDy},
    {"dz", VoxelFeature::kDz},    {"height", VoxelFeature::kHeight},
    {"ux", VoxelFeature::kUx},    {"uy", VoxelFeature::kUy},
    {"zero", VoxelFeature::kZero}};
const Names<VoxelNextBranch> kBranches = {{"hm", VoxelNextBranch::kHm},
                                          {"center", VoxelNextBranch::kCenter},
                                          {"center_z", VoxelNextBranch::kCenterZ},
                                          {"dim", VoxelNextBranch::kDim},
                                          {"rot", VoxelNextBranch::kRot},
                                          {"iou", VoxelNextBranch::kIou},
                                          {"vel", VoxelNextBranch::kVel}};
const Names<VoxelNextHeight> kHeights = {{"ground", VoxelNextHeight::kGround},
                                         {"lidar", VoxelNextHeight::kLidar}};
const Names<VoxelNextYaw> kYaws = {{"direction", VoxelNextYaw::kDirection},
                                   {"axis", VoxelNextYaw::kAxis}};
const Names<VoxelNextSuppression> kSuppressions = {{"rotated", VoxelNextSuppression::kRotated},
                                                   {"maxpool", VoxelNextSuppression::kMaxPool},
                                                   {"fitted", VoxelNextSuppression::kFitted}};

/// Beyond a kilometre no LiDAR returns; a voxel below 1 cm is finer than its noise.
constexpr double kMaxRange_m = 1000.0;
constexpr double kMinVoxel_m = 0.01;
constexpr double kMaxVoxel_m = 10.0;

void read_grid(const JsonField& config, VoxelNextConfig& result) {
  const auto range = config.at("range_m").elements(6, 6);
  for (std::size_t i = 0; i < 6; ++i) {
    result.range_m[i] = range[i].number(-kMaxRange_m, kMaxRange_m);
  }
  const auto voxel = config.at("voxel_m").elements(3, 3);
  double grid = 1.0;
  for (std::size_t i = 0; i < 3; ++i) {
    result.voxel_m[i] = voxel[i].number(kMinVoxel_m, kMaxVoxel_m);
    const double extent_m = result.range_m[i + 3] - result.range_m[i];
    const double cells = std::round(extent_m / result.voxel_m[i]);
    if (!(cells >= 1.0 && cells <= kMaxVoxelNextCells)) {
      voxel[i].refuse("1 to " + std::to_string(kMaxVoxelNextCells) + " of them in " +
                      nlohmann::json(extent_m).dump() + " m");
    }
    grid *= i == 2 ? cells + 1.0 : cells;  // one more in z, see voxel_grid
  }
  if (!(grid <= kMaxVoxelNextGrid)) {
    config.at("voxel_m").refuse("at most 2^29 of them in range_m");
  }
}

void read_stages(const JsonField& config, VoxelNextConfig& result) {
  const auto stages = config.at("stages").elements(6, 6);
  for (std::size_t i = 0; i < 6; ++i) {
    stages[i].exactly({"channels", "blocks", "kernel"});
    result.stages[i].channels = stages[i].at("channels").whole(1, kMaxVoxelNextChannels);
    result.stages[i].blocks = stages[i].at("blocks").whole(0, kMaxVoxelNextBlocks);
    result.stages[i].kernel = stages[i].at("kernel").whole(1, 7);
    if (result.stages[i].kernel % 2 == 0) stages[i].at("kernel").refuse("an odd number");
  }
  for (std::size_t i = 4; i < 6; ++i) {
    if (result.stages[i].channels == result.stages[3].channels) continue;
    stages[i]
        .at("channels")
        .refuse(std::to_string(result.stages[3].channels) +
                ", as stage 4 has, since they are summed");
  }
}

void read_pruning(const JsonField& config, VoxelNextConfig& result) {
  const auto shares = config.at("pruning").elements(5, 5);
  for (std::size_t i = 0; i < 5; ++i) {
    result.pruning[i] = shares[i].number(0.0, 1.0);
    if (!(result.pruning[i] < 1.0)) shares[i].refuse("a number below 1");
  }
}

/// @return the number of classes of all heads together.
std::size_t read_heads(const JsonField& config, VoxelNextConfig& result) {
  std::size_t classes = 0;
  for (const JsonField& head : config.at("heads").elements(1, kMaxVoxelNextHeads)) {
    head.exactly({"classes"});
    VoxelNextHead& read = result.heads.emplace_back();
    for (const JsonField& name : head.at("classes").elements(1, kMaxVoxelNextClasses)) {
      const std::string text = name.text();
      const auto object_class = maps::object_class_from(text);
      if (!text.empty() && !object_class) name.refuse("the name of an object class, or \"\"");
      read.classes.push_back(object_class);
    }
    classes += read.classes.size();
  }
  return classes;
}

void read_branches(const JsonField& config, VoxelNextConfig& result) {
  const JsonField branches = config.at("branches");
  result.branches = branches.set_of(kBranches);
  for (const auto& [name, branch] : kBranches) {
    if (branch == VoxelNextBranch::kIou || branch == VoxelNextBranch::kVel) continue;
    if (std::ranges::find(result.branches, branch) == result.branches.end()) {
      branches.refuse("\"" + std::string(name) + "\" among them");
    }
  }
}

void read_scores(const JsonField& config, std::size_t classes, VoxelNextConfig& result) {
  const bool has_iou =
      std::ranges::find(result.branches, VoxelNextBranch::kIou) != result.branches.end();
  for (const JsonField& power : config.at("iou_rectifier").elements(classes, classes)) {
    result.iou_rectifier.push_back(power.number(0.0, 1.0));
    if (!has_iou && result.iou_rectifier.back() != 0.0)
      power.refuse("0 without the branch \"iou\"");
  }
  for (const JsonField& pair : config.at("calibration").elements(classes, classes)) {
    const auto scale_shift = pair.elements(2, 2);
    // A scale of 0 or below would say that every box is as good as any other, or turn them round.
    result.calibration.push_back(
        {.scale = scale_shift[0].number(1e-3, 1e3), .shift = scale_shift[1].number(-1e3, 1e3)});
  }
  result.nms = config.at("nms").one_of(kSuppressions);
  result.nms_iou = config.at("nms_iou").number(0.0, 1.0);
}

void read_thresholds(const JsonField& threshold, bool by_class, std::size_t classes,
                     VoxelNextConfig& result) {
  if (!by_class) {
    result.score_threshold.assign(classes, threshold.number(0.0, 1.0));
    return;
  }
  for (const JsonField& of_class : threshold.elements(classes, classes))
    result.score_threshold.push_back(of_class.number(0.0, 1.0));
}

}  // namespace

VoxelNextConfig parse_voxelnext_config(std::string_view text, const std::string& name) {
  const nlohmann::json parsed = maps::parse_json(text, name + " at config");
  const JsonField config(parsed, name, "config");
  config.exactly({"name", "range_m", "voxel_m", "z", "sensor_height_m", "features", "stages",
                  "pruning", "neck_channels", "head_kernel", "heads", "yaw", "branches",
                  "iou_rectifier", "calibration", "nms", "nms_iou", "score_threshold"});
  VoxelNextConfig result;
  result.name = config.at("name").text();
  // It goes into manifests and messages.
  if (result.name.empty() || maps::one_line(result.name) != result.name) {
    config.at("name").refuse("1 to 60 printable letters");
  }
  read_grid(config, result);
  result.z = config.at("z").one_of(kHeights);
  result.sensor_height_m = config.at("sensor_height_m").number(-10.0, 100.0);
  result.features = config.at("features").set_of(kFeatures);
  read_stages(config, result);
  read_pruning(config, result);
  result.neck_channels = config.at("neck_channels").whole(1, kMaxVoxelNextChannels);
  result.head_kernel = config.at("head_kernel").whole(1, 3);
  if (result.head_kernel == 2) config.at("head_kernel").refuse("1 or 3");
  const std::size_t classes = read_heads(config, result);
  result.yaw = config.at("yaw").one_of(kYaws);
  read_branches(config, result);
  read_scores(config, classes, result);
  read_thresholds(config.at("score_threshold"), parsed.at("score_threshold").is_array(), classes,
                  result);
  return result;
}

}  // namespace stillmap::mapping
