#pragma once

#include <optional>
#include <string>
#include <vector>

namespace stillmap::server {

/// What a job that succeeded came to.
struct JobOutcome {
  std::string version{};
  std::string digest{};
  bool activated = false;
  /// Why it was asked for and not done.
  std::vector<std::string> not_activated_because{};
  /// What the gate found, as the mapper's report has it; empty for a job without a gate.
  std::string gate{};
};

[[nodiscard]] std::string to_json(const JobOutcome& outcome);

/// What a rebuild's report says of the gate.
struct GateReport {
  bool passed = false;
  std::vector<std::string> reasons;
  /// Verdict, reasons, warnings, figures, checks and held-back scans, as JSON.
  std::string json;
};
/// Nothing when it is no report.
[[nodiscard]] std::optional<GateReport> read_report(const std::string& text);

}  // namespace stillmap::server
