#include "json_fields.hpp"

#include <stillmap/maps/error.hpp>

#include <cmath>
#include <limits>

namespace stillmap::maps {
namespace {

/// Messages stay one line, whatever the file holds.
std::string shortened(const nlohmann::json& value) {
  constexpr std::size_t kLongest = 60;
  if (value.is_structured()) {
    return value.is_array() ? "an array of " + std::to_string(value.size()) : "an object";
  }
  std::string text = value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  if (text.size() > kLongest) text = text.substr(0, kLongest) + "...";
  return text;
}

}  // namespace

void JsonField::refuse(const std::string& expected) const {
  throw InputError(file_ + (path_.empty() ? "" : " at " + path_), shortened(value_), expected);
}

std::string JsonField::one_line(std::string key) {
  for (char& c : key) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  return key;
}

bool JsonField::has(const std::string& key) const {
  return value_.is_object() && value_.contains(key);
}

JsonField JsonField::at(const std::string& key) const {
  if (!value_.is_object()) refuse("an object with \"" + key + "\"");
  const auto it = value_.find(key);
  const std::string where = path_ + "." + key;
  if (it == value_.end()) throw InputError(file_ + " at " + where, "nothing", "a value");
  return {*it, file_, where};
}

std::string JsonField::text() const {
  if (!value_.is_string()) refuse("a text");
  return value_.get<std::string>();
}

bool JsonField::boolean() const {
  if (!value_.is_boolean()) refuse("true or false");
  return value_.get<bool>();
}

double JsonField::number() const {
  constexpr double kMax = std::numeric_limits<double>::max();
  return number(-kMax, kMax);
}

double JsonField::number(double low, double high) const {
  if (!value_.is_number()) refuse("a number");
  const double number = value_.get<double>();
  if (!(number >= low && number <= high)) {
    constexpr double kMax = std::numeric_limits<double>::max();
    refuse(low == -kMax && high == kMax ? "a finite number"
                                        : "a number from " + nlohmann::json(low).dump() + " to " +
                                              nlohmann::json(high).dump());
  }
  return number;
}

std::int64_t JsonField::integer(std::int64_t low, std::int64_t high) const {
  const std::string expected =
      "a whole number from " + std::to_string(low) + " to " + std::to_string(high);
  if (!value_.is_number_integer()) refuse(expected);
  if (value_.is_number_unsigned() &&
      value_.get<std::uint64_t>() > std::uint64_t{std::numeric_limits<std::int64_t>::max()}) {
    refuse(expected);
  }
  const auto number = value_.get<std::int64_t>();
  if (number < low || number > high) refuse(expected);
  return number;
}

std::uint64_t JsonField::count() const {
  if (!value_.is_number_unsigned()) refuse("a whole number >= 0");
  return value_.get<std::uint64_t>();
}

Eigen::Vector3d JsonField::vector3() const {
  if (!value_.is_array() || value_.size() != 3) refuse("three numbers");
  Eigen::Vector3d vector;
  Eigen::Index i = 0;
  each([&](const JsonField& field) { vector[i++] = field.number(); });
  return vector;
}

nlohmann::json parse_json(std::string_view text, const std::string& file) {
  try {
    return nlohmann::json::parse(text);
  } catch (const nlohmann::json::exception& error) {
    throw InputError(file, error.what(), "JSON");
  }
}

}  // namespace stillmap::maps
