#include <stillmap/maps/json_fields.hpp>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace stillmap::maps {
namespace {

constexpr std::size_t kMaxDepth = 8;
constexpr double kMaxNumber = std::numeric_limits<double>::max();

/// Refuses depth and doubled keys while the text is read, before anything is built of it. Not as a
/// callback of `json::parse`, which looks at all of a parent after each of its objects.
class Guard final : public nlohmann::json::json_sax_t {
 public:
  explicit Guard(const std::string& name) : name_(name) {}

  bool null() override { return true; }
  bool boolean(bool /*value*/) override { return true; }
  bool number_integer(number_integer_t /*value*/) override { return true; }
  bool number_unsigned(number_unsigned_t /*value*/) override { return true; }
  bool number_float(number_float_t /*value*/, const string_t& /*text*/) override { return true; }
  bool string(string_t& /*value*/) override { return true; }
  bool binary(binary_t& /*value*/) override { return true; }

  bool start_object(std::size_t /*unknown*/) override { return open(); }
  bool end_object() override { return close(); }
  bool start_array(std::size_t /*unknown*/) override { return open(); }
  bool end_array() override { return close(); }

  bool key(string_t& key) override {
    if (keys_.back().insert(key).second) return true;
    throw InputError(name_, "key " + described(key) + " twice", "it once");
  }

  bool parse_error(std::size_t /*at*/, const std::string& /*token*/,
                   const nlohmann::json::exception& error) override {
    throw InputError(name_, "no JSON (" + one_line(error.what(), 200) + ")", "JSON");
  }

 private:
  bool open() {
    if (keys_.size() == kMaxDepth)
      throw InputError(name_, "JSON nested more than " + std::to_string(kMaxDepth) + " deep",
                       "at most that");
    keys_.emplace_back();
    return true;
  }

  bool close() {
    keys_.pop_back();
    return true;
  }

  const std::string& name_;
  /// Of each array or object that has not ended; an array has none.
  std::vector<std::set<std::string>> keys_;
};

}  // namespace

std::string described(const nlohmann::json& value) {
  if (value.is_array()) return "an array of " + std::to_string(value.size());
  if (value.is_object()) return "an object";
  return one_line(value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
}

nlohmann::json parse_json(std::string_view text, const std::string& name) {
  Guard guard(name);
  nlohmann::json::sax_parse(text, &guard);
  return nlohmann::json::parse(text);
}

std::string JsonField::place() const { return file_ + (path_.empty() ? "" : " at " + path_); }

std::string JsonField::path_of(const std::string& key) const { return path_ + "." + one_line(key); }

JsonField JsonField::element(std::size_t index) const {
  return {value_[index], file_, path_ + "[" + std::to_string(index) + "]"};
}

void JsonField::refuse(const std::string& expected) const {
  throw InputError(place(), described(value_), expected);
}

bool JsonField::has(const std::string& key) const {
  return value_.is_object() && value_.contains(key);
}

JsonField JsonField::at(const std::string& key) const {
  if (!value_.is_object()) refuse("an object with \"" + key + "\"");
  const auto it = value_.find(key);
  if (it == value_.end()) throw InputError(file_ + " at " + path_of(key), "nothing", "a value");
  return {*it, file_, path_of(key)};
}

void JsonField::only(std::initializer_list<std::string_view> keys) const {
  each_member([&](const std::string& key, const JsonField&) {
    if (std::ranges::find(keys, std::string_view(key)) != keys.end()) return;
    std::string known;
    for (const std::string_view name : keys)
      known += (known.empty() ? "" : ", ") + std::string(name);
    throw InputError(place(), "unknown key " + described(key), "only " + known);
  });
}

void JsonField::exactly(std::initializer_list<std::string_view> keys) const {
  only(keys);
  for (const std::string_view key : keys) static_cast<void>(at(std::string(key)));
}

std::vector<JsonField> JsonField::elements(std::size_t least, std::size_t most) const {
  if (!value_.is_array() || value_.size() < least || value_.size() > most) {
    const bool no_bounds = least == 0 && most == std::numeric_limits<std::size_t>::max();
    refuse(no_bounds ? "an array"
                     : "an array of " + std::to_string(least) +
                           (most == least ? "" : " to " + std::to_string(most)));
  }
  std::vector<JsonField> fields;
  fields.reserve(value_.size());
  for (std::size_t i = 0; i < value_.size(); ++i) fields.push_back(element(i));
  return fields;
}

std::string JsonField::text() const {
  if (!value_.is_string()) refuse("a text");
  return value_.get<std::string>();
}

bool JsonField::boolean() const {
  if (!value_.is_boolean()) refuse("true or false");
  return value_.get<bool>();
}

double JsonField::number() const { return number(-kMaxNumber, kMaxNumber); }

double JsonField::number(double low, double high) const {
  const double number =
      value_.is_number() ? value_.get<double>() : std::numeric_limits<double>::quiet_NaN();
  if (!(number >= low && number <= high)) {
    refuse(low == -kMaxNumber && high == kMaxNumber
               ? "a finite number"
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

Eigen::Vector3d JsonField::vector3() const { return vector3(-kMaxNumber, kMaxNumber); }

Eigen::Vector3d JsonField::vector3(double low, double high) const {
  if (!value_.is_array() || value_.size() != 3) refuse("three numbers");
  Eigen::Vector3d vector;
  for (std::size_t i = 0; i < 3; ++i)
    vector[static_cast<Eigen::Index>(i)] = element(i).number(low, high);
  return vector;
}

nlohmann::json transform_json(const Eigen::Isometry3d& T) {
  const Eigen::Vector3d p = T.translation();
  const Eigen::Quaterniond q(T.linear());
  return {{"position", {p.x(), p.y(), p.z()}}, {"quaternion", {q.x(), q.y(), q.z(), q.w()}}};
}

Eigen::Isometry3d JsonField::transform() const {
  // What a quaternion written by hand with 3 decimals can be off.
  constexpr double kMaxOffUnit = 1e-3;
  std::vector<double> q;
  const JsonField quaternion = at("quaternion");
  quaternion.each([&](const JsonField& value) { q.push_back(value.number()); });
  if (q.size() != 4) quaternion.refuse("four numbers x y z w");
  const Eigen::Quaterniond rotation(q[3], q[0], q[1], q[2]);
  if (!(std::abs(rotation.norm() - 1.0) <= kMaxOffUnit)) quaternion.refuse("norm 1");
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = rotation.normalized().toRotationMatrix();
  T.translation() = at("position").vector3();
  return T;
}

}  // namespace stillmap::maps
