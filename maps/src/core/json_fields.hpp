#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::maps {

/// A JSON value with the file and the path it stands at, read with every type and bound checked.
/// Each accessor throws InputError "FILE at PATH: found ..., expected ...".
class JsonField {
 public:
  JsonField(const nlohmann::json& value, std::string file, std::string path = "")
      : value_(value), file_(std::move(file)), path_(std::move(path)) {}

  [[nodiscard]] JsonField at(const std::string& key) const;
  [[nodiscard]] bool has(const std::string& key) const;
  /// Calls `visit(JsonField)` for every element of an array.
  template <typename Visit>
  void each(Visit&& visit) const {
    if (!value_.is_array()) refuse("an array");
    for (std::size_t i = 0; i < value_.size(); ++i) {
      visit(JsonField(value_[i], file_, path_ + "[" + std::to_string(i) + "]"));
    }
  }
  /// Calls `visit(key, JsonField)` for every member of an object, keys sorted.
  template <typename Visit>
  void each_member(Visit&& visit) const {
    if (!value_.is_object()) refuse("an object");
    for (auto it = value_.begin(); it != value_.end(); ++it) {
      visit(it.key(), JsonField(it.value(), file_, path_ + "." + one_line(it.key())));
    }
  }

  [[nodiscard]] std::string text() const;
  [[nodiscard]] bool boolean() const;
  /// A finite number.
  [[nodiscard]] double number() const;
  /// A finite number in [low, high].
  [[nodiscard]] double number(double low, double high) const;
  [[nodiscard]] std::int64_t integer(std::int64_t low, std::int64_t high) const;
  [[nodiscard]] std::uint64_t count() const;
  /// An array of three finite numbers.
  [[nodiscard]] Eigen::Vector3d vector3() const;

  [[noreturn]] void refuse(const std::string& expected) const;

 private:
  /// Control characters as '?', so that a key neither ends nor breaks a message.
  [[nodiscard]] static std::string one_line(std::string key);

  const nlohmann::json& value_;
  std::string file_;
  std::string path_;
};

/// @throws InputError naming the file and the position of the mistake.
[[nodiscard]] nlohmann::json parse_json(std::string_view text, const std::string& file);

}  // namespace stillmap::maps
