#include "detection/boxes_detector.hpp"
#include "detection/geometric_detector.hpp"
#include "detection/onnx/onnx_detector.hpp"
#include "detection/onnx/onnx_session.hpp"

#include <stillmap/mapping/detector.hpp>

#include <stdexcept>

namespace stillmap::mapping {

std::unique_ptr<Detector> make_detector(const std::string& spec, std::size_t scan_count) {
  constexpr std::string_view kBoxes = "boxes:", kOnnx = "onnx:";
  if (spec == "geometric") return std::make_unique<GeometricDetector>();
  if (spec.starts_with(kBoxes) && spec.size() > kBoxes.size())
    return std::make_unique<BoxesDetector>(
        maps::read_boxes(spec.substr(kBoxes.size()), scan_count));
  if (spec.starts_with(kOnnx) && spec.size() > kOnnx.size())
    return std::make_unique<OnnxDetector>(spec.substr(kOnnx.size()), onnx_runtime_library());
  throw std::invalid_argument("detector: found '" + spec +
                              "', expected geometric, boxes:FILE or onnx:FILE");
}

}  // namespace stillmap::mapping
