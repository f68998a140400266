#pragma once

#include "units/survey_records.hpp"
#include "views/range_view_store.hpp"

#include <cstddef>
#include <map>
#include <memory>
#include <shared_mutex>

namespace stillmap::mapping {

/// What a survey found in single scans, from its records. A view is asked for many times, and a
/// record holds much more, so views move into a store when they are first asked for. Safe from
/// several threads.
class JournaledViews {
 public:
  /// @param records, store  outlive this. @param store  empty.
  JournaledViews(const SurveyRecords& records, RangeViewStore& store)
      : records_(records), store_(store) {}

  /// Of a scan that is placed next: its file must be the one that was surveyed.
  [[nodiscard]] FoundInScan found(std::size_t scan) const;
  [[nodiscard]] std::shared_ptr<const RangeView> view(std::size_t scan) const;

 private:
  [[nodiscard]] std::shared_ptr<const RangeView> known(std::size_t scan) const;
  void keep(const SurveyedScan& surveyed) const;

  const SurveyRecords& records_;
  RangeViewStore& store_;
  /// Appending to the store excludes reading.
  mutable std::shared_mutex mutex_;
  /// By scan: number in the store.
  mutable std::map<std::size_t, std::size_t> numbers_;
};

}  // namespace stillmap::mapping
