#pragma once

#include <stillmap/mapping/ground.hpp>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>

#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Stage "detect": objects that could move, moving or parked.
class Detector {
 public:
  virtual ~Detector() = default;
  /// @return boxes in the scan's lidar frame. Safe from several threads. Same input, same bits.
  [[nodiscard]] virtual std::vector<maps::Box> detect(const maps::Scan& scan,
                                                      const GroundResult& ground) const = 0;
  /// Boxes that were given but belong to no scan or are no object, by reason.
  [[nodiscard]] virtual std::map<std::string, std::size_t> dropped() const { return {}; }
};

/// Name of the detector without a network.
inline constexpr std::string_view kGeometricDetector = "geometric";
/// Name of the detector by the network that is shipped with the program.
inline constexpr std::string_view kVoxelNextDetector = "voxelnext";

/// @param spec        `geometric`, `voxelnext` (the weights shipped with the program),
///                    `voxelnext:FILE` (weights as safetensors), `onnx:FILE` (a description,
///                    see mapping/onnx.md) or `boxes:FILE`.
/// @param scan_count  of the drive, see `maps::read_boxes`.
/// @throws std::invalid_argument for an unknown name, maps::InputError for a broken file.
[[nodiscard]] std::unique_ptr<Detector> make_detector(const std::string& spec,
                                                      std::size_t scan_count);

}  // namespace stillmap::mapping
