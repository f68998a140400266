#pragma once

#include "drives/drive_set.hpp"
#include "pipeline/build_journal.hpp"
#include "pipeline/scan_work.hpp"

#include <cstddef>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace stillmap::mapping {

struct Build;

/// A record of a survey cannot be used, nor can those behind it.
struct UnusableRecord : std::runtime_error {
  /// @param keep_records  those before it. @param why  empty: broken bytes, as a power cut leaves
  /// them.
  UnusableRecord(std::size_t keep_records, const std::string& why)
      : std::runtime_error(why), keep(keep_records) {}
  std::size_t keep;
};

/// One of `shares` about equal shares of `scans` scans. @param number  in [1, shares].
[[nodiscard]] ScanRange share_of_scans(std::size_t scans, std::size_t number, std::size_t shares);

/// Name of the journal of a share, and of that of a whole survey.
[[nodiscard]] std::string survey_stage_name(std::size_t number, std::size_t shares);
inline constexpr const char* kWholeSurvey = "survey";

/// @param journal  of the scans from `first` on.
/// @throws UnusableRecord; with a reason when the scan's file is not the one that was surveyed.
[[nodiscard]] SurveyedScan surveyed_before(const BuildJournal& journal, std::size_t first,
                                           const DriveSet& drives, std::size_t scan);

/// What the survey units of a build wrote down. Safe from several threads.
class SurveyRecords {
 public:
  /// @param shares  survey units. @throws maps::InputError naming a unit that is not done.
  SurveyRecords(const Build& build, std::size_t shares);

  /// @throws maps::InputError when the scan's file is not the one that was surveyed, or the record
  /// is broken.
  [[nodiscard]] SurveyedScan read(std::size_t scan) const;
  /// Of all records, as `BuildJournal::sum`.
  [[nodiscard]] std::string sum() const;

 private:
  const DriveSet& drives_;
  std::vector<ScanRange> ranges_;
  std::vector<std::unique_ptr<BuildJournal>> journals_;
};

}  // namespace stillmap::mapping
