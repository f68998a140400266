#pragma once

#include "detection/onnx/onnx_config.hpp"
#include "detection/onnx/onnx_session.hpp"

#include <stillmap/mapping/detector.hpp>

#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// A user's dense centre-based network (CenterPoint, PointPillars with a centre head), run by ONNX
/// Runtime.
class OnnxDetector final : public Detector {
 public:
  /// @param description  see `read_onnx_config`. @param library  see `OnnxSession`.
  /// @throws maps::InputError also for a model whose tensors are not those of the description.
  OnnxDetector(const std::filesystem::path& description, const std::string& library);
  /// @throws maps::InputError when the model cannot run or gives other shapes than described.
  [[nodiscard]] std::vector<maps::Box> detect(const maps::Scan& scan,
                                              const GroundResult& ground) const override;

 private:
  OnnxConfig config_;
  OnnxSession session_;
};

}  // namespace stillmap::mapping
