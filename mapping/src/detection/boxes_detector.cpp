#include "detection/boxes_detector.hpp"

namespace stillmap::mapping {

std::vector<maps::Box> BoxesDetector::detect(const maps::Scan& scan,
                                             const GroundResult& /*ground*/) const {
  const auto boxes = boxes_.by_scan.find(scan.index);
  return boxes == boxes_.by_scan.end() ? std::vector<maps::Box>{} : boxes->second;
}

}  // namespace stillmap::mapping
