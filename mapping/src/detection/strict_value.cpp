#include "detection/strict_value.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <limits>

namespace stillmap::mapping {

using maps::InputError;

void StrictValue::refuse(const std::string& expected) const {
  throw InputError(path_, described(value_), expected);
}

void StrictValue::only(std::initializer_list<std::string_view> keys) const {
  if (!value_.is_object()) refuse("an object");
  for (const std::string_view key : keys) {
    if (!value_.contains(key)) throw InputError(path_, "no " + in_quotes(key), "a value for it");
  }
  for (auto member = value_.begin(); member != value_.end(); ++member) {
    if (std::ranges::find(keys, std::string_view(member.key())) != keys.end()) continue;
    throw InputError(path_, "unknown key " + in_quotes(member.key()), "only those of version 1");
  }
}

StrictValue StrictValue::at(const std::string& key) const {
  if (!value_.is_object() || !value_.contains(key))
    throw InputError(path_, "no " + in_quotes(key), "a value for it");
  return {value_.at(key), path_ + "." + key};
}

std::vector<StrictValue> StrictValue::elements(std::size_t least, std::size_t most) const {
  if (!value_.is_array() || value_.size() < least || value_.size() > most) {
    refuse("an array of " + std::to_string(least) +
           (most == least ? "" : " to " + std::to_string(most)));
  }
  std::vector<StrictValue> values;
  for (std::size_t i = 0; i < value_.size(); ++i)
    values.emplace_back(value_[i], path_ + "[" + std::to_string(i) + "]");
  return values;
}

std::string StrictValue::text() const {
  if (!value_.is_string()) refuse("a text");
  return value_.get<std::string>();
}

double StrictValue::number(double low, double high) const {
  const double found =
      value_.is_number() ? value_.get<double>() : std::numeric_limits<double>::quiet_NaN();
  if (!(found >= low && found <= high))
    refuse("a number from " + nlohmann::json(low).dump() + " to " + nlohmann::json(high).dump());
  return found;
}

int StrictValue::whole(int low, int high) const {
  const double found =
      value_.is_number_integer() ? value_.get<double>() : std::numeric_limits<double>::quiet_NaN();
  if (!(found >= low && found <= high))
    refuse("a whole number from " + std::to_string(low) + " to " + std::to_string(high));
  return value_.get<int>();
}

}  // namespace stillmap::mapping
