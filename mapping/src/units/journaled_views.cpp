#include "units/journaled_views.hpp"

#include <mutex>
#include <utility>

namespace stillmap::mapping {

std::shared_ptr<const RangeView> JournaledViews::known(std::size_t scan) const {
  const std::shared_lock lock(mutex_);
  const auto number = numbers_.find(scan);
  return number == numbers_.end() ? nullptr : store_.read(number->second);
}

void JournaledViews::keep(const SurveyedScan& surveyed) const {
  const std::unique_lock lock(mutex_);
  // Another thread may have been faster.
  if (numbers_.contains(surveyed.scan)) return;
  store_.append(surveyed.view.value());
  numbers_[surveyed.scan] = store_.size() - 1;
}

FoundInScan JournaledViews::found(std::size_t scan) const {
  SurveyedScan surveyed = records_.read_checked(scan);
  keep(surveyed);
  return {std::move(surveyed.is_ground), std::move(surveyed.weather)};
}

std::shared_ptr<const RangeView> JournaledViews::view(std::size_t scan) const {
  if (auto view = known(scan)) return view;
  keep(records_.read(scan));
  return known(scan);
}

}  // namespace stillmap::mapping
