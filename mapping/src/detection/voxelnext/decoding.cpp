#include "detection/voxelnext/decoding.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace stillmap::mapping {

namespace {

/// Cells of stage 4 are 8 voxels wide.
constexpr double kStride = 8.0;
/// Of the log of a size: 0.7 cm to 148 m, as CenterPoint's decoder has it.
constexpr double kMostLogSize = 5.0;

/// Number of a head's first class among all.
std::size_t first_class(const VoxelNextConfig& config, std::size_t head) {
  std::size_t out = 0;
  for (std::size_t h = 0; h < head; ++h) out += config.heads[h].classes.size();
  return out;
}

double sigmoid(double x) { return 1.0 / (1.0 + std::exp(-x)); }

/// Whether no active neighbour has a larger logit of the class.
bool is_peak(const SiteSet& cells, const FeatureRows& logits, std::size_t site,
             std::size_t head_class) {
  const Triple& at = cells[site];
  const float own = logits.row(site)[head_class];
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      const std::uint32_t other = cells.find({at.z, at.y + dy, at.x + dx});
      if (other != SiteSet::kNone && logits.row(other)[head_class] > own) return false;
    }
  }
  return true;
}

/// A row of head outputs by branch; null without that branch.
class BranchRow {
 public:
  BranchRow(const HeadBoxes& boxes, std::size_t row) : boxes_(boxes), row_(row) {}
  [[nodiscard]] double operator()(VoxelNextBranch branch, std::size_t channel) const {
    return static_cast<double>(boxes_.values.row(row_)[boxes_.column.at(branch) + channel]);
  }
  [[nodiscard]] bool has(VoxelNextBranch branch) const { return boxes_.column.contains(branch); }

 private:
  const HeadBoxes& boxes_;
  std::size_t row_;
};

double score_of(double probability, double rectifier, const BranchRow& row) {
  if (!row.has(VoxelNextBranch::kIou) || rectifier == 0.0) return probability;
  const double iou = std::clamp((row(VoxelNextBranch::kIou, 0) + 1.0) / 2.0, 0.0, 1.0);
  return std::pow(probability, 1.0 - rectifier) * std::pow(iou, rectifier);
}

/// Below it no IoU can lift the score over the threshold.
double least_probability(double threshold, double rectifier) {
  return rectifier < 1.0 ? std::pow(threshold, 1.0 / (1.0 - rectifier)) : 0.0;
}

std::optional<maps::Box> decode(const VoxelNextConfig& config, const Triple& cell,
                                const BranchRow& row, const NetworkHeight& height) {
  maps::Box box;
  const double centre_x =
      (cell.x + row(VoxelNextBranch::kCenter, 0)) * kStride * config.voxel_m[0] + config.range_m[0];
  const double centre_y =
      (cell.y + row(VoxelNextBranch::kCenter, 1)) * kStride * config.voxel_m[1] + config.range_m[1];
  for (Eigen::Index k = 0; k < 3; ++k) {
    const double log_size = row(VoxelNextBranch::kDim, static_cast<std::size_t>(k));
    box.size_m[k] = std::exp(std::clamp(log_size, -kMostLogSize, kMostLogSize));
  }
  const double angle = std::atan2(row(VoxelNextBranch::kRot, 1), row(VoxelNextBranch::kRot, 0));
  box.yaw_rad = config.yaw == VoxelNextYaw::kAxis ? angle / 2.0 : angle;
  if (!std::isfinite(centre_x) || !std::isfinite(centre_y)) return std::nullopt;
  const std::optional<double> zero = height.zero_at(centre_x, centre_y);
  if (!zero) return std::nullopt;
  box.centre = {centre_x, centre_y, row(VoxelNextBranch::kCenterZ, 0) + *zero};
  if (!box.centre.allFinite() || !box.size_m.allFinite() || !std::isfinite(box.yaw_rad))
    return std::nullopt;
  return box;
}

}  // namespace

std::vector<Candidate> find_candidates(const VoxelNextConfig& config, std::size_t head,
                                       const SiteSet& cells, const FeatureRows& logits) {
  const std::vector<std::optional<maps::ObjectClass>>& classes = config.heads[head].classes;
  const std::size_t first = first_class(config, head);
  std::vector<double> least;
  for (std::size_t c = 0; c < classes.size(); ++c)
    least.push_back(
        least_probability(config.score_threshold[first + c], config.iou_rectifier[first + c]));
  std::vector<Candidate> out;
  for (std::size_t site = 0; site < cells.size(); ++site) {
    for (std::size_t c = 0; c < classes.size(); ++c) {
      if (!classes[c]) continue;
      const VoxelNextCalibration& calibration = config.calibration[first + c];
      const auto logit = static_cast<double>(logits.row(site)[c]);
      const double p = sigmoid(calibration.scale * logit + calibration.shift);
      if (!(p >= least[c])) continue;
      if (config.nms == VoxelNextSuppression::kMaxPool && !is_peak(cells, logits, site, c))
        continue;
      out.push_back({static_cast<std::uint32_t>(site), c, p});
    }
  }
  return out;
}

std::vector<maps::Box> decode_boxes(const VoxelNextConfig& config, std::size_t head,
                                    const std::vector<Candidate>& candidates, const SiteSet& cells,
                                    const HeadBoxes& at, const NetworkHeight& height) {
  const std::size_t first = first_class(config, head);
  std::vector<maps::Box> out;
  for (const Candidate& candidate : candidates) {
    const auto found = std::lower_bound(at.cells.begin(), at.cells.end(), candidate.cell);
    const BranchRow row(at, static_cast<std::size_t>(found - at.cells.begin()));
    std::optional<maps::Box> box = decode(config, cells[candidate.cell], row, height);
    if (!box) continue;
    const std::size_t flat = first + candidate.head_class;
    box->score = score_of(candidate.probability, config.iou_rectifier[flat], row);
    if (!(box->score >= config.score_threshold[flat])) continue;
    box->object_class = *config.heads[head].classes[candidate.head_class];
    out.push_back(*box);
  }
  return out;
}

}  // namespace stillmap::mapping
