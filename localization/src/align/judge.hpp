#pragma once

#include "support.hpp"
#include "uncertainty.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/options.hpp>

namespace stillmap::localization {

/// Inputs of the verdict, apart from the pose.
struct Evidence {
  Support support;
  Observability observability;
  /// A second place explains the scan about as well.
  bool ambiguous = false;
  /// The prior's covariance speaks against the pose.
  bool contradicts_prior = false;
  /// The scan was taken on the move and does not say when its points were.
  bool not_deskewed = false;
};
/// Sets status and reasons. Lost: nothing to support a pose; degraded: something is weak; ok: all
/// is well.
void judge(const Evidence& evidence, const Matrix6d& covariance, const VerdictOptions& options,
           AlignmentResult& result);

}  // namespace stillmap::localization
