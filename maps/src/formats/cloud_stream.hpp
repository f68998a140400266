#pragma once

#include <stillmap/maps/cloud_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <span>
#include <string_view>
#include <vector>

#include "formats/point_table.hpp"

namespace stillmap::maps {

/// What of a cloud's bytes may be its header.
inline std::string_view header_part(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()),
          std::min(bytes.size(), kMostCloudHeaderBytes)};
}

/// As `PointTable`, for points that are handed on as they come.
class CloudStream {
 public:
  using Take = std::function<void(std::span<const CloudPoint>)>;

  /// @param held  points between two calls of `reached`, at most.
  CloudStream(std::span<const PointField> fields, std::span<const Role> roles, std::size_t held,
              const Take& take)
      : points_(held), take_(&take) {
    for (std::size_t i = 0; i < roles.size(); ++i) {
      // Hostile headers have thousands; a summary has not.
      if (i < 64) summary_.fields.push_back(fields[i].name.substr(0, 32));
      const bool is_coordinate =
          roles[i] == Role::kX || roles[i] == Role::kY || roles[i] == Role::kZ;
      summary_.single_precision |= is_coordinate && fields[i].type == NumberType::kF32;
    }
  }

  /// Whether `set` has a use for it.
  static bool takes(Role role) { return role != Role::kNone && role != Role::kTime; }

  void set(Role role, std::size_t point, double value) {
    CloudPoint& at = points_[point - first_];
    switch (role) {
      case Role::kX:
        at.position.x() = value;
        return;
      case Role::kY:
        at.position.y() = value;
        return;
      case Role::kZ:
        at.position.z() = value;
        return;
      case Role::kIntensity:
        // Doubles beyond floats are not finite either.
        at.intensity =
            std::abs(value) <= std::numeric_limits<float>::max() ? static_cast<float>(value) : 0.0F;
        return;
      case Role::kTime:
      case Role::kNone:
        return;
    }
  }

  /// All points below this one are set.
  void reached(std::size_t end) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < end - first_; ++i) {
      if (points_[i].position.allFinite()) points_[kept++] = points_[i];
    }
    summary_.points_in_file += end - first_;
    summary_.non_finite += end - first_ - kept;
    first_ = end;
    if (kept > 0) (*take_)(std::span(points_).first(kept));
  }

  [[nodiscard]] const CloudSummary& summary() const { return summary_; }

 private:
  std::vector<CloudPoint> points_;
  const Take* take_;
  /// Number of the point that stands first.
  std::size_t first_ = 0;
  CloudSummary summary_;
};

/// Rows that are read before they are handed on.
inline constexpr std::size_t kRowsAtOnce = 65536;

}  // namespace stillmap::maps
