#include "detection/boxes_detector.hpp"
#include "detection/geometric_detector.hpp"
#include "detection/voxelnext/embedded_weights.hpp"
#include "detection/voxelnext/voxelnext_detector.hpp"
#include "detection/voxelnext/weights.hpp"

#include <stillmap/mapping/detector.hpp>
#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <span>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// No sensor sees as far, and no object is as long [m]; what claims to be comes from a broken file,
/// and tables laid over it would take all memory.
constexpr double kFarthestM = 1e6;
constexpr double kLongestM = 200.0;

maps::BoxSequence read_bounded(const std::string& file, std::size_t scan_count) {
  maps::BoxSequence sequence = maps::read_boxes(file, scan_count);
  for (const auto& [scan, boxes] : sequence.by_scan) {
    for (const maps::Box& box : boxes) {
      if ((box.centre.array().abs() <= kFarthestM).all() && box.size_m.maxCoeff() <= kLongestM)
        continue;
      throw maps::InputError(fmt::format("{}: scan {}", file, scan),
                             fmt::format("a box at {:g} {:g} {:g} of {:g} x {:g} x {:g} m",
                                         box.centre.x(), box.centre.y(), box.centre.z(),
                                         box.size_m.x(), box.size_m.y(), box.size_m.z()),
                             fmt::format("within {:g} m of the sensor and at most {:g} m long",
                                         kFarthestM, kLongestM));
    }
  }
  return sequence;
}

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
  constexpr std::string_view kBoxes = "boxes:", kVoxelNext = "voxelnext:";
  if (spec == "geometric") return std::make_unique<GeometricDetector>();
  if (spec.starts_with(kBoxes) && spec.size() > kBoxes.size())
    return std::make_unique<BoxesDetector>(read_bounded(spec.substr(kBoxes.size()), scan_count));
  if (spec == "voxelnext") return shipped_voxelnext();
  if (spec.starts_with(kVoxelNext) && spec.size() > kVoxelNext.size())
    return std::make_unique<VoxelNextDetector>(
        read_voxelnext_weights(spec.substr(kVoxelNext.size())));
  throw std::invalid_argument("detector: found '" + spec +
                              "', expected geometric, voxelnext, voxelnext:FILE or boxes:FILE");
}

}  // namespace stillmap::mapping
