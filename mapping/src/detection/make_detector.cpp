#include "detection/boxes_detector.hpp"
#include "detection/geometric_detector.hpp"
#include "detection/onnx/onnx_detector.hpp"
#include "detection/onnx/onnx_session.hpp"
#include "detection/voxelnext/embedded_weights.hpp"
#include "detection/voxelnext/voxelnext_detector.hpp"
#include "detection/voxelnext/weights.hpp"

#include <stillmap/mapping/detector.hpp>

#include <span>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

std::unique_ptr<Detector> shipped_voxelnext() {
  const std::span<const std::byte> weights = embedded_weights();
  if (weights.empty()) {
    throw std::invalid_argument(
        "detector: found 'voxelnext', but this program was built without weights; expected "
        "voxelnext:FILE");
  }
  return std::make_unique<VoxelNextDetector>(
      read_voxelnext_weights(weights, "shipped VoxelNeXt weights"));
}

}  // namespace

std::unique_ptr<Detector> make_detector(const std::string& spec, std::size_t scan_count) {
  constexpr std::string_view kBoxes = "boxes:", kVoxelNext = "voxelnext:", kOnnx = "onnx:";
  if (spec == kGeometricDetector) return std::make_unique<GeometricDetector>();
  if (spec.starts_with(kBoxes) && spec.size() > kBoxes.size())
    return std::make_unique<BoxesDetector>(
        maps::read_boxes(spec.substr(kBoxes.size()), scan_count));
  if (spec == kVoxelNextDetector) return shipped_voxelnext();
  if (spec.starts_with(kVoxelNext) && spec.size() > kVoxelNext.size())
    return std::make_unique<VoxelNextDetector>(
        read_voxelnext_weights(spec.substr(kVoxelNext.size())));
  if (spec.starts_with(kOnnx) && spec.size() > kOnnx.size())
    return std::make_unique<OnnxDetector>(spec.substr(kOnnx.size()), onnx_runtime_library());
  throw std::invalid_argument(
      "detector: found '" + spec +
      "', expected geometric, voxelnext, voxelnext:FILE, onnx:FILE or boxes:FILE");
}

}  // namespace stillmap::mapping
