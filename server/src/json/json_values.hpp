#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace stillmap::server {

/// Keys in the order of their writing.
using Json = nlohmann::ordered_json;

template <typename Derived>
[[nodiscard]] Json to_json_array(const Eigen::DenseBase<Derived>& values) {
  Json array = Json::array();
  for (Eigen::Index row = 0; row < values.rows(); ++row) {
    for (Eigen::Index column = 0; column < values.cols(); ++column)
      array.push_back(values(row, column));
  }
  return array;
}

/// {"position": [x, y, z], "quaternion": [x, y, z, w]} with w >= 0.
[[nodiscard]] inline Json to_json_pose(const Eigen::Isometry3d& T) {
  Eigen::Quaterniond q(T.linear());
  if (q.w() < 0.0) q.coeffs() *= -1.0;
  Json pose;
  pose["position"] = to_json_array(T.translation());
  pose["quaternion"] = to_json_array(q.normalized().coeffs());
  return pose;
}

/// Nanoseconds exceed what a JSON number holds exactly.
[[nodiscard]] inline Json time_of(std::int64_t time_ns) { return std::to_string(time_ns); }
[[nodiscard]] inline Json time_of(const std::optional<std::int64_t>& time_ns) {
  return time_ns ? time_of(*time_ns) : Json();
}

/// Text that is valid UTF-8 whatever bytes file names and clients brought in.
[[nodiscard]] inline std::string to_text(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace stillmap::server
