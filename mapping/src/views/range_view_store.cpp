#include "views/range_view_store.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Views held in memory, some 0.3 MiB each: what several threads at neighbouring places of a map
/// ask for. A tile asks for all views of some 110 m of way, one after the other.
constexpr std::size_t kCachedViews = 160;

}  // namespace

RangeViewStore::RangeViewStore(const std::filesystem::path& folder)
    : file_(folder, "range_views") {}

void RangeViewStore::append(const RangeView& view) {
  const std::string bytes = view.to_bytes();
  places_.push_back({file_.append(bytes.data(), bytes.size()), bytes.size()});
}

RangeView RangeViewStore::load(const Place& place) const {
  std::string bytes(place.bytes, '\0');
  file_.read(place.offset, bytes.data(), bytes.size());
  try {
    return RangeView::from_bytes(bytes);
  } catch (const std::invalid_argument& error) {
    throw maps::StorageError(file().string(),
                             fmt::format("at byte {}: {}", place.offset, error.what()));
  }
}

std::shared_ptr<const RangeView> RangeViewStore::cached(std::size_t ordinal) const {
  const std::scoped_lock lock(mutex_);
  for (auto at = cache_.begin(); at != cache_.end(); ++at) {
    if (at->ordinal != ordinal) continue;
    cache_.splice(cache_.begin(), cache_, at);
    return at->view;
  }
  return nullptr;
}

void RangeViewStore::remember(std::size_t ordinal,
                              const std::shared_ptr<const RangeView>& view) const {
  const std::scoped_lock lock(mutex_);
  cache_.push_front({ordinal, view});
  if (cache_.size() > kCachedViews) cache_.pop_back();
}

std::shared_ptr<const RangeView> RangeViewStore::read(std::size_t ordinal) const {
  const Place place = places_.at(ordinal);
  if (auto view = cached(ordinal)) return view;
  auto view = std::make_shared<const RangeView>(load(place));
  remember(ordinal, view);
  return view;
}

}  // namespace stillmap::mapping
