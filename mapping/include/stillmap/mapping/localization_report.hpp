#pragma once

#include <stillmap/mapping/localization_evaluation.hpp>

#include <string>
#include <utility>
#include <vector>

namespace stillmap::mapping {

/// What a report says of itself; plain text, escaped when it is written.
struct LocalizationReportHeading {
  std::string map;
  std::string drive;
  std::string method;
  /// How to make it again.
  std::string command;
};

/// A page of `--report`: one HTML file that needs no other, without scripts. Success by prior
/// error, errors, integrity (Stanford diagrams: level against true error), calibration of the
/// covariance, times, status and reasons, options.
/// @note  The same evaluation gives the same bytes; only the times differ from run to run.
[[nodiscard]] std::string to_html(const LocalizationEvaluation& evaluation,
                                  const LocalizationReportHeading& heading);

}  // namespace stillmap::mapping
