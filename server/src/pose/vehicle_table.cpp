#include "pose/vehicle_table.hpp"

namespace stillmap::server {

void VehicleTable::seen(const std::string& map, const std::string& label,
                        const std::string& version, std::string_view status, std::int64_t now_ns) {
  if (label.empty()) return;
  const Key key(map, label);
  const std::scoped_lock lock(mutex_);
  auto found = vehicles_.find(key);
  if (found == vehicles_.end()) {
    order_.push_front(key);
    found = vehicles_.emplace(key, Entry{{.label = label}, order_.begin()}).first;
    if (vehicles_.size() > kMost) {
      vehicles_.erase(order_.back());
      order_.pop_back();
    }
  } else {
    order_.splice(order_.begin(), order_, found->second.place);
  }
  Vehicle& vehicle = found->second.vehicle;
  vehicle.version = version;
  vehicle.last_seen_ns = now_ns;
  if (!status.empty()) vehicle.answers.add(status);
}

std::vector<VehicleTable::Vehicle> VehicleTable::list(const std::string& map,
                                                      const std::string& after,
                                                      std::size_t most) const {
  std::vector<Vehicle> found;
  const std::scoped_lock lock(mutex_);
  for (auto each = vehicles_.upper_bound({map, after});
       each != vehicles_.end() && each->first.first == map && found.size() < most; ++each)
    found.push_back(each->second.vehicle);
  return found;
}

void VehicleTable::forget(const std::string& map) {
  const std::scoped_lock lock(mutex_);
  for (auto each = vehicles_.lower_bound({map, ""});
       each != vehicles_.end() && each->first.first == map;) {
    order_.erase(each->second.place);
    each = vehicles_.erase(each);
  }
}

}  // namespace stillmap::server
