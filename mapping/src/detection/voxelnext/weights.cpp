#include "detection/voxelnext/weights.hpp"

#include <stdexcept>

namespace stillmap::mapping {

std::string_view name_of(VoxelNextBranch branch) {
  switch (branch) {
    case VoxelNextBranch::kHm:
      return "hm";
    case VoxelNextBranch::kCenter:
      return "center";
    case VoxelNextBranch::kCenterZ:
      return "center_z";
    case VoxelNextBranch::kDim:
      return "dim";
    case VoxelNextBranch::kRot:
      return "rot";
    case VoxelNextBranch::kIou:
      return "iou";
    case VoxelNextBranch::kVel:
      return "vel";
  }
  throw std::invalid_argument("branch: no such value");
}

int channels_of(VoxelNextBranch branch, std::size_t classes) {
  switch (branch) {
    case VoxelNextBranch::kHm:
      return static_cast<int>(classes);
    case VoxelNextBranch::kCenter:
    case VoxelNextBranch::kRot:
    case VoxelNextBranch::kVel:
      return 2;
    case VoxelNextBranch::kDim:
      return 3;
    case VoxelNextBranch::kCenterZ:
    case VoxelNextBranch::kIou:
      return 1;
  }
  throw std::invalid_argument("branch: no such value");
}

const Convolution& VoxelNextWeights::layer(std::string_view name) const {
  const auto found = layers_.find(name);
  if (found == layers_.end())
    throw std::invalid_argument("voxelnext weights: no layer '" + std::string(name) + "'");
  return found->second;
}

}  // namespace stillmap::mapping
