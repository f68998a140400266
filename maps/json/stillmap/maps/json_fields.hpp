#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// The one strict reader of JSON files, for the libraries of this repository: link stillmap_json to
// find this header. It is no public header of maps, because it shows nlohmann's types. The server's
// RequestReader (bounds while the body is read) and ConfigReader (line numbers, all faults at once)
// need more than this and stay.
namespace stillmap::maps {

/// A value for a message: a scalar as it stands in the file, on one line and shortened; of an array
/// its size.
[[nodiscard]] std::string described(const nlohmann::json& value);

/// JSON that names no key of an object twice and nests at most 8 deep. A reader that keeps the last
/// of two equal keys would read another file than the one that a careful eye reads.
/// @param name what the text is, for messages. @throws InputError naming it and the mistake.
[[nodiscard]] nlohmann::json parse_json(std::string_view text, const std::string& name);

/// {"position": [x, y, z], "quaternion": [x, y, z, w]}.
[[nodiscard]] nlohmann::json transform_json(const Eigen::Isometry3d& T);

/// A JSON value with the file and the path where it stands, read with every type and bound checked.
/// Each accessor throws InputError "FILE at PATH: found ..., expected ...".
class JsonField {
 public:
  template <typename Meaning>
  using Names = std::initializer_list<std::pair<std::string_view, Meaning>>;

  /// @param value must outlive it. @param path begins with a dot where it is a key.
  JsonField(const nlohmann::json& value, std::string file, std::string path = "")
      : value_(value), file_(std::move(file)), path_(std::move(path)) {}

  [[nodiscard]] JsonField at(const std::string& key) const;
  [[nodiscard]] bool has(const std::string& key) const;
  /// An object without other keys than these.
  void only(std::initializer_list<std::string_view> keys) const;
  /// An object with these keys and no other.
  void exactly(std::initializer_list<std::string_view> keys) const;

  /// The elements of an array of `least` to `most`.
  [[nodiscard]] std::vector<JsonField> elements(
      std::size_t least = 0, std::size_t most = std::numeric_limits<std::size_t>::max()) const;
  /// Calls `visit(JsonField)` for every element of an array.
  template <typename Visit>
  void each(Visit&& visit) const {
    if (!value_.is_array()) refuse("an array");
    for (std::size_t i = 0; i < value_.size(); ++i) visit(element(i));
  }
  /// Calls `visit(key, JsonField)` for every member of an object, keys sorted.
  template <typename Visit>
  void each_member(Visit&& visit) const {
    if (!value_.is_object()) refuse("an object");
    for (auto it = value_.begin(); it != value_.end(); ++it)
      visit(it.key(), JsonField(it.value(), file_, path_of(it.key())));
  }

  [[nodiscard]] std::string text() const;
  [[nodiscard]] bool boolean() const;
  /// A finite number.
  [[nodiscard]] double number() const;
  /// A finite number in [low, high].
  [[nodiscard]] double number(double low, double high) const;
  [[nodiscard]] std::int64_t integer(std::int64_t low, std::int64_t high) const;
  /// As `integer`.
  [[nodiscard]] int whole(int low, int high) const { return static_cast<int>(integer(low, high)); }
  [[nodiscard]] std::uint64_t count() const;
  /// An array of three finite numbers.
  [[nodiscard]] Eigen::Vector3d vector3() const;
  /// An array of three numbers in [low, high].
  [[nodiscard]] Eigen::Vector3d vector3(double low, double high) const;

  /// As `transform_json` writes it; the quaternion's norm 1 within 1e-3.
  [[nodiscard]] Eigen::Isometry3d transform() const;

  /// What a name stands for.
  template <typename Meaning>
  [[nodiscard]] Meaning one_of(Names<Meaning> names) const {
    std::string expected;
    for (const auto& [name, meaning] : names) {
      if (value_ == name) return meaning;
      expected += (expected.empty() ? "" : ", ") + std::string(name);
    }
    refuse("one of " + expected);
  }
  /// An array of one name or more, none of them twice.
  template <typename Meaning>
  [[nodiscard]] std::vector<Meaning> set_of(Names<Meaning> names) const {
    std::vector<Meaning> meanings;
    for (const JsonField& field : elements(1, names.size())) {
      const Meaning meaning = field.one_of(names);
      for (const Meaning& known : meanings)
        if (known == meaning) field.refuse("a name once");
      meanings.push_back(meaning);
    }
    return meanings;
  }

  [[noreturn]] void refuse(const std::string& expected) const;

 private:
  [[nodiscard]] JsonField element(std::size_t index) const;
  [[nodiscard]] std::string path_of(const std::string& key) const;
  [[nodiscard]] std::string place() const;

  const nlohmann::json& value_;
  std::string file_;
  std::string path_;
};

}  // namespace stillmap::maps
