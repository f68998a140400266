#pragma once

#include <algorithm>
#include <cstddef>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

namespace stillmap::server {

/// Some shared things by name; of more than `most` those that were not used for longest go. Safe
/// from several threads.
template <typename Value>
class RecentlyUsed {
 public:
  explicit RecentlyUsed(std::size_t most) : most_(most) {}

  /// Null when there is none.
  [[nodiscard]] std::shared_ptr<const Value> find(const std::string& name) {
    const std::scoped_lock lock(mutex_);
    const auto found = std::find_if(values_.begin(), values_.end(),
                                    [&](const auto& each) { return each.first == name; });
    if (found == values_.end()) return nullptr;
    values_.splice(values_.begin(), values_, found);
    return values_.front().second;
  }
  void put(const std::string& name, std::shared_ptr<const Value> value) {
    const std::scoped_lock lock(mutex_);
    std::erase_if(values_, [&](const auto& each) { return each.first == name; });
    values_.emplace_front(name, std::move(value));
    if (values_.size() > most_) values_.pop_back();
  }
  void forget(const std::string& name) {
    const std::scoped_lock lock(mutex_);
    std::erase_if(values_, [&](const auto& each) { return each.first == name; });
  }

 private:
  std::size_t most_;
  std::mutex mutex_;
  /// The one that was used last is the first.
  std::list<std::pair<std::string, std::shared_ptr<const Value>>> values_;
};

}  // namespace stillmap::server
