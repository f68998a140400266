#pragma once

#include <stillmap/maps/box.hpp>

#include <array>
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::mapping {

/// What the network calls z.
enum class VoxelNextHeight {
  /// Height over the local ground surface.
  kGround,
  /// As measured, shifted so that the ground under the sensor lies at -sensor_height_m.
  kLidar,
};

/// Input channels: means over the points of a voxel.
enum class VoxelFeature {
  kX,          ///< [m]
  kY,          ///< [m]
  kZ,          ///< [m], in the network's z
  kIntensity,  ///< as read; 0 where there is none
  kZero,       ///< constant 0 (nuScenes' time stamp)
  kDx,         ///< (point - voxel centre) / voxel size, in [-0.5, 0.5]
  kDy,
  kDz,
  kHeight,  ///< the network's z [m]
  kUx,      ///< x/r, y/r with r = hypot(x, y) of the mean point; 0 where r = 0
  kUy,
};

/// What a head says of a cell.
enum class VoxelNextBranch {
  kHm,       ///< logit of each class of the head
  kCenter,   ///< x, y offset [cells]
  kCenterZ,  ///< [m], in the network's z
  kDim,      ///< log of length, width, height [m]
  kRot,      ///< cos, sin of the yaw, or of twice the yaw
  kIou,      ///< expected IoU, -1 to 1
  kVel,      ///< velocity, not used
};

/// What the branch "rot" says.
enum class VoxelNextYaw {
  kDirection,  ///< cos, sin of the yaw, as OpenPCDet has it
  /// cos, sin of twice the yaw: the box's axis. Which end is the front a single scan of a parked
  /// car hardly shows, and two opposite answers that are as good as each other average to none.
  kAxis,
};

/// How boxes of one object become one.
enum class VoxelNextSuppression {
  kRotated,
  kMaxPool,
  /// As kRotated; then boxes of vehicles go to where their points are, see box_fit.hpp.
  kFitted,
};

struct VoxelNextStage {
  int channels = 0;
  int blocks = 0;
  /// Of the strided convolution that opens stages 2 to 6, odd; ignored in stage 1.
  int kernel = 3;
};

/// Share of the active cells that do not dilate in the strided convolution that opens each of the
/// stages 2 to 6, those of the smallest features; in [0, 1), 0: all dilate. See pruning.hpp.
using VoxelNextPruning = std::array<double, 5>;

struct VoxelNextHead {
  /// None: a class that is no object for us; its boxes are dropped.
  std::vector<std::optional<maps::ObjectClass>> classes;
};

/// p = sigmoid(scale * logit + shift).
struct VoxelNextCalibration {
  double scale = 1.0;
  double shift = 0.0;
};

/// The `config` text of a weights file, checked.
struct VoxelNextConfig {
  std::string name;
  /// x, y, z minima, then maxima [m]; points outside [min, max) are dropped.
  std::array<double, 6> range_m{};
  std::array<double, 3> voxel_m{};
  VoxelNextHeight z = VoxelNextHeight::kGround;
  /// Only used with kLidar.
  double sensor_height_m = 0.0;
  std::vector<VoxelFeature> features;
  std::array<VoxelNextStage, 6> stages{};
  VoxelNextPruning pruning{};
  int neck_channels = 0;
  /// 1 or 3.
  int head_kernel = 1;
  std::vector<VoxelNextHead> heads;
  VoxelNextYaw yaw = VoxelNextYaw::kDirection;
  std::vector<VoxelNextBranch> branches;
  /// a of score = p^(1-a) * clamp((iou+1)/2, 0, 1)^a, in [0, 1], for each class in head order.
  std::vector<double> iou_rectifier;
  /// For each class in head order.
  std::vector<VoxelNextCalibration> calibration;
  VoxelNextSuppression nms = VoxelNextSuppression::kRotated;
  /// BEV IoU above which the box of lower score goes, all classes together; not with kMaxPool.
  double nms_iou = 0.2;
  /// Boxes of lower score are left out: for each class in head order. A file may give one number
  /// for all classes.
  std::vector<double> score_threshold;
};

/// One convolution with its normalization folded in.
struct Convolution {
  /// Kernel positions, row-major over (z, y, x), or (y, x) in 2D.
  int kernel_volume = 0;
  int in_channels = 0;
  int out_channels = 0;
  /// [kernel_volume][in_channels][out_channels]
  std::vector<float> weight;
  /// [out_channels]
  std::vector<float> bias;
};

/// The name of a branch in layer names ("hm", "center", ...).
[[nodiscard]] std::string_view name_of(VoxelNextBranch branch);
/// Channels that a branch gives out; `classes` of its head.
[[nodiscard]] int channels_of(VoxelNextBranch branch, std::size_t classes);

class VoxelNextWeights {
 public:
  VoxelNextConfig config;

  void add(std::string name, Convolution convolution) {
    layers_.insert_or_assign(std::move(name), std::move(convolution));
  }
  /// @throws std::invalid_argument naming a layer that is not there.
  [[nodiscard]] const Convolution& layer(std::string_view name) const;
  [[nodiscard]] std::size_t size() const { return layers_.size(); }

 private:
  std::map<std::string, Convolution, std::less<>> layers_;
};

/// Reads a safetensors file of format "stillmap-voxelnext", version 1. Every layer that the config
/// asks for is there in the shape it asks for, every number is finite, and nothing else is there.
/// @throws maps::InputError, maps::StorageError.
[[nodiscard]] VoxelNextWeights read_voxelnext_weights(const std::filesystem::path& file);
/// The same of a file's bytes. @param name  for messages.
[[nodiscard]] VoxelNextWeights read_voxelnext_weights(std::span<const std::byte> bytes,
                                                      const std::string& name);

}  // namespace stillmap::mapping
