#pragma once

#include <stillmap/mapping/ground.hpp>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "support/temporary_folder.hpp"

namespace stillmap::mapping::test_onnx {

/// Height of the ground [m]; none is known from x = 3.5 on.
constexpr double kGround = -1.8;

class FlatGround final : public GroundSurface {
 public:
  [[nodiscard]] std::optional<Sample> at(double x, double /*y*/) const override {
    if (x >= 3.5) return std::nullopt;
    return Sample{kGround, Eigen::Vector3d::UnitZ(), 1.0};
  }
};

inline GroundResult flat_ground() { return {{}, std::make_shared<FlatGround>()}; }

/// Description of the bev.onnx that tests/data/onnx/make_networks.py writes.
inline nlohmann::json bev_description() {
  return {{"format", "stillmap-onnx"},
          {"version", 1},
          {"model", "bev.onnx"},
          {"range_m", {0, -2, -1, 4, 2, 3}},
          {"cell_m", {0.5, 0.5}},
          {"z", "ground"},
          {"sensor_height_m", 0},
          {"input", {{"kind", "bev"}, {"tensor", "bev"}, {"channels", {"max_z", "log_count"}}}},
          {"stride", 2},
          {"scores", "logits"},
          {"sizes", "log"},
          {"rotation", "cos_sin"},
          {"heads", nlohmann::json::array({{{"classes", {"car", "pedestrian"}},
                                            {"heat_map", "logits"},
                                            {"offset", "offset"},
                                            {"height", "height"},
                                            {"size", "size"},
                                            {"rotation", "rotation"}}})},
          {"score_threshold", 0.3},
          {"nms", "rotated"},
          {"nms_iou", 0.2}};
}

/// Description of the pillars.onnx that tests/data/onnx/make_networks.py writes.
inline nlohmann::json pillars_description() {
  nlohmann::json text = bev_description();
  text["model"] = "pillars.onnx";
  text["range_m"] = {0, -2, -1, 6, 2, 3};
  text["cell_m"] = {1, 1};
  text["stride"] = 1;
  text["input"] = {{"kind", "pillars"}, {"points", "points"},
                   {"cells", "cells"},  {"counts", "counts"},
                   {"most_points", 4},  {"features", {"z", "mean_dz", "centre_dx"}}};
  text["scores"] = "scores";
  text["sizes"] = "metres";
  text["rotation"] = "sin_cos";
  text["heads"][0]["classes"] = nlohmann::json::array({"car"});
  text["heads"][0]["heat_map"] = "scores";
  return text;
}

/// A description in a folder of its own, with the committed networks beside it.
class Described {
 public:
  explicit Described(const nlohmann::json& description) {
    file_ = folder_.write("network.json", description.dump());
    for (const char* name : {"bev.onnx", "pillars.onnx"})
      std::filesystem::copy_file(std::filesystem::path(STILLMAP_ONNX_NETWORKS) / name,
                                 folder_.path() / name);
  }
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  [[nodiscard]] const test::TemporaryFolder& folder() const { return folder_; }

 private:
  test::TemporaryFolder folder_;
  std::filesystem::path file_;
};

}  // namespace stillmap::mapping::test_onnx
