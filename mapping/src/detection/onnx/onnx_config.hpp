#pragma once

#include "detection/voxelnext/weights.hpp"

#include <stillmap/maps/box.hpp>

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Channels of a picture from above; 0 in a cell without points.
enum class BevChannel {
  kMaxZ,           ///< [m], in the network's z
  kMeanZ,          ///< [m]
  kLogCount,       ///< ln(1 + points)
  kMeanIntensity,  ///< as read; 0 where there is none
};

/// What is said of each point of a pillar.
enum class PillarFeature {
  kX,          ///< [m]
  kY,          ///< [m]
  kZ,          ///< [m], in the network's z
  kIntensity,  ///< as read; 0 where there is none
  kMeanDx,     ///< point minus the mean of its pillar's points [m]
  kMeanDy,
  kMeanDz,
  kCentreDx,  ///< point minus the centre of its pillar [m]
  kCentreDy,
};

/// One tensor [1, channels, rows, columns] of floats.
struct BevInput {
  std::string tensor;
  std::vector<BevChannel> channels;
};

/// PointPillars' input (Lang et al., CVPR 2019, section 2.1) for P pillars with points; the network
/// scatters them onto its grid itself.
struct PillarInput {
  /// [P, most_points, features] of floats, 0 beyond a pillar's count.
  std::string points;
  /// [P, 4]: 0, 0, row, column.
  std::string cells;
  /// [P]
  std::string counts;
  std::vector<PillarFeature> features;
  /// Of a pillar; those that come later in the scan are left out.
  int most_points = 0;
};

/// Tensors of one head of a centre-based network, each [1, channels, rows / stride,
/// columns / stride] of floats.
struct OnnxHead {
  /// None: a class that is no object for us; its boxes are dropped.
  std::vector<std::optional<maps::ObjectClass>> classes;
  std::string heat_map;  ///< a channel for each class
  std::string offset;    ///< x, y within the cell [cells of the head]
  std::string height;    ///< z of the box's centre [m], in the network's z
  std::string size;      ///< length, width, height
  std::string rotation;  ///< of the heading, two channels
};

/// A user's description of a network, checked. Rows go along y, columns along x, both from the
/// minimum.
struct OnnxConfig {
  /// The description, for messages.
  std::string name;
  std::filesystem::path model;
  /// x, y, z minima, then maxima [m]; points outside [min, max) are dropped.
  std::array<double, 6> range_m{};
  /// Size of a cell along x, y [m]; the range is a whole number of them, and of `stride` cells.
  std::array<double, 2> cell_m{};
  int rows = 0;
  int columns = 0;
  VoxelNextHeight z = VoxelNextHeight::kGround;
  /// Only used with kLidar.
  double sensor_height_m = 0.0;
  /// Exactly one of the two.
  std::optional<BevInput> bev;
  std::optional<PillarInput> pillars;
  /// Cells of the input in a cell of the heads along each axis.
  int stride = 1;
  bool scores_are_logits = true;
  bool sizes_are_logs = true;
  bool cosine_first = true;
  std::vector<OnnxHead> heads;
  double score_threshold = 0.0;
  /// Only cells that no neighbour of the 3x3 around surpasses, instead of what follows.
  bool peaks_only = false;
  /// BEV IoU above which the box of lower score goes, all classes together.
  double nms_iou = 0.0;
};

/// Reads a description; its keys are in mapping/onnx.md. The model lies beside it.
/// @throws maps::InputError "FILE at KEY: found ..., expected ...", maps::StorageError.
[[nodiscard]] OnnxConfig read_onnx_config(const std::filesystem::path& file);

}  // namespace stillmap::mapping
