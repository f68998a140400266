#pragma once

#include <stillmap/mapping/detector.hpp>
#include <stillmap/maps/box.hpp>

namespace stillmap::mapping {

/// Boxes that were given for each scan: labels, or what another detector found.
class BoxesDetector final : public Detector {
 public:
  explicit BoxesDetector(maps::BoxSequence boxes) : boxes_(std::move(boxes)) {}
  [[nodiscard]] std::vector<maps::Box> detect(const maps::Scan& scan,
                                              const GroundResult& ground) const override;
  [[nodiscard]] std::map<std::string, std::size_t> dropped() const override {
    return boxes_.dropped;
  }

 private:
  maps::BoxSequence boxes_;
};

}  // namespace stillmap::mapping
