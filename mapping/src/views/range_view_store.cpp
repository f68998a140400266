#include "views/range_view_store.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Views held in memory, some 0.3 MiB each: what several threads at neighbouring places of a map
/// ask for.
constexpr std::size_t kCachedViews = 32;

}  // namespace

RangeViewStore::RangeViewStore(const std::filesystem::path& folder) {
  std::string name = (folder / "range_views.XXXXXX").string();
  descriptor_ = ::mkstemp(name.data());
  if (descriptor_ < 0) throw maps::StorageError(name, std::strerror(errno));
  file_ = name;
}

RangeViewStore::~RangeViewStore() {
  ::close(descriptor_);
  std::error_code ignored;
  std::filesystem::remove(file_, ignored);
}

void RangeViewStore::append(const RangeView& view) {
  const std::string bytes = view.to_bytes();
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t written = ::pwrite(descriptor_, bytes.data() + done, bytes.size() - done,
                                     static_cast<off_t>(end_ + done));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw maps::StorageError(file_.string(), std::strerror(errno));
    if (written == 0) throw maps::StorageError(file_.string(), "nothing could be written");
    done += static_cast<std::size_t>(written);
  }
  places_.push_back({end_, bytes.size()});
  end_ += bytes.size();
}

RangeView RangeViewStore::load(const Place& place) const {
  std::string bytes(place.bytes, '\0');
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t got = ::pread(descriptor_, bytes.data() + done, bytes.size() - done,
                                static_cast<off_t>(place.offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw maps::StorageError(file_.string(), std::strerror(errno));
    if (got == 0)
      throw maps::StorageError(
          file_.string(), fmt::format("ends at byte {}, expected {}", place.offset + done, end_));
    done += static_cast<std::size_t>(got);
  }
  try {
    return RangeView::from_bytes(bytes);
  } catch (const std::invalid_argument& error) {
    throw maps::StorageError(file_.string(),
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
