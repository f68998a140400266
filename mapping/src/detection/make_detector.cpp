#include "detection/geometric_detector.hpp"
#include "detection/onnx/onnx_detector.hpp"
#include "detection/onnx/onnx_session.hpp"
#include "detection/voxelnext/embedded_weights.hpp"
#include "detection/voxelnext/voxelnext_detector.hpp"
#include "detection/voxelnext/weights.hpp"

#include <stillmap/mapping/detector.hpp>
#include <stillmap/maps/box.hpp>

#include <map>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Boxes that were given for each scan: labels, or what another detector found.
class BoxesDetector final : public Detector {
 public:
  explicit BoxesDetector(maps::BoxSequence boxes) : boxes_(std::move(boxes)) {}
  [[nodiscard]] std::vector<maps::Box> detect(const maps::Scan& scan,
                                              const GroundResult& /*ground*/) const override {
    const auto boxes = boxes_.by_scan.find(scan.index);
    return boxes == boxes_.by_scan.end() ? std::vector<maps::Box>{} : boxes->second;
  }
  [[nodiscard]] std::map<std::string, std::size_t> dropped() const override {
    return boxes_.dropped;
  }

 private:
  maps::BoxSequence boxes_;
};

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
