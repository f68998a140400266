#include "units/journaled_views.hpp"

#include <mutex>
#include <utility>

namespace stillmap::mapping {

FoundInScan JournaledViews::found(std::size_t scan) const {
  SurveyedScan surveyed = records_.read(scan);
  return {std::move(surveyed.is_ground), std::move(surveyed.weather)};
}

std::shared_ptr<const RangeView> JournaledViews::view(std::size_t scan) const {
  {
    const std::shared_lock lock(mutex_);
    const auto known = numbers_.find(scan);
    if (known != numbers_.end()) return store_.read(known->second);
  }
  const SurveyedScan surveyed = records_.read(scan);
  const std::unique_lock lock(mutex_);
  // Another thread may have been faster.
  if (!numbers_.contains(scan)) {
    store_.append(surveyed.view.value());
    numbers_[scan] = store_.size() - 1;
  }
  return store_.read(numbers_.at(scan));
}

}  // namespace stillmap::mapping
