#pragma once

#include "reference/terms.hpp"

#include <stillmap/localization/aligner.hpp>

#include <memory>

namespace stillmap::localization {

/// A method from the literature behind our interface: one start at the prior, no search, then the
/// verdict of the default (`judge`) over this method's own support and covariance, and
/// `not_converged` when it was still moving. No protection levels: those are calibrated for the
/// default. Every answer needs a prior.
class ReferenceAligner : public Aligner {
 public:
  /// @param map  thinned to the method's `map_leaf_m`. @throws std::invalid_argument if null.
  ReferenceAligner(std::shared_ptr<const MapPoints> map, const ReferenceMethod& method);
  [[nodiscard]] AlignmentResult align(const maps::PointCloud& scan_lidar,
                                      const std::optional<Prior>& prior) const override;

 private:
  std::shared_ptr<const MapPoints> map_;
  ReferenceMethod method_;
};

}  // namespace stillmap::localization
