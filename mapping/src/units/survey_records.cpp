#include "units/survey_records.hpp"

#include "pipeline/build.hpp"
#include "pipeline/build_key.hpp"
#include "pipeline/surveyed_scan_bytes.hpp"

#include <stillmap/mapping/build_units.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace stillmap::mapping {

ScanRange share_of_scans(std::size_t scans, std::size_t number, std::size_t shares) {
  return {scans * (number - 1) / shares, scans * number / shares};
}

std::string survey_stage_name(std::size_t number, std::size_t shares) {
  return fmt::format("survey_{}_of_{}", number, shares);
}

SurveyRecords::SurveyRecords(const Build& build, std::size_t shares) : drives_(*build.drives) {
  const std::string key = survey_key(build);
  for (std::size_t number = 1; number <= shares; ++number) {
    ranges_.push_back(share_of_scans(drives_.size(), number, shares));
    journals_.push_back(std::make_unique<BuildJournal>(build.task.journal_folder,
                                                       survey_stage_name(number, shares), key,
                                                       BuildJournal::Use::kRead));
    journals_.back()->require_complete(name_of(BuildUnit{BuildUnit::Kind::kSurvey, number}));
  }
}

std::size_t SurveyRecords::share_of(std::size_t scan) const {
  const auto range = std::find_if(ranges_.begin(), ranges_.end(),
                                  [scan](const ScanRange& each) { return scan < each.end; });
  return static_cast<std::size_t>(range - ranges_.begin());
}

SurveyedScan SurveyRecords::read(std::size_t scan) const {
  const std::size_t share = share_of(scan);
  const BuildJournal& journal = *journals_.at(share);
  const std::string unit = name_of(BuildUnit{BuildUnit::Kind::kSurvey, share + 1});
  const std::string bytes = journal.require(scan - ranges_[share].begin, unit);
  try {
    SurveyedScan surveyed = surveyed_scan_from(bytes);
    if (surveyed.scan == scan) return surveyed;
    throw std::invalid_argument(fmt::format("scan {} in place of {}", surveyed.scan, scan));
  } catch (const std::invalid_argument& error) {
    throw maps::InputError(
        journal.file().string(), error.what(),
        fmt::format("what the unit '{0}' wrote: remove the file and do --unit {0} again", unit));
  }
}

SurveyedScan SurveyRecords::read_checked(std::size_t scan) const {
  SurveyedScan surveyed = read(scan);
  if (surveyed.sha256 == drives_.sha256(scan)) return surveyed;
  throw maps::InputError(
      drives_.name(scan), "other bytes than were surveyed",
      fmt::format("a scan that does not change: do --unit {} and all units after it again",
                  name_of(BuildUnit{BuildUnit::Kind::kSurvey, share_of(scan) + 1})));
}

std::string SurveyRecords::sum() const {
  std::string sums;
  for (const auto& journal : journals_) sums += journal->sum();
  return maps::sha256_of(sums);
}

}  // namespace stillmap::mapping
