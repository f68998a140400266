#pragma once

#include <initializer_list>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "detection/strict_json.hpp"

namespace stillmap::mapping {

/// A value of a network's description with the path it stands at. Whatever is not as asked for is
/// refused by maps::InputError with path, what was found and what was expected.
class StrictValue {
 public:
  template <typename Meaning>
  using Names = std::initializer_list<std::pair<std::string_view, Meaning>>;

  /// @param value  must outlive it.
  StrictValue(const nlohmann::json& value, std::string path)
      : value_(value), path_(std::move(path)) {}

  [[noreturn]] void refuse(const std::string& expected) const;
  /// An object with exactly these keys.
  void only(std::initializer_list<std::string_view> keys) const;
  [[nodiscard]] StrictValue at(const std::string& key) const;
  /// The elements of an array of `least` to `most`.
  [[nodiscard]] std::vector<StrictValue> elements(std::size_t least, std::size_t most) const;
  [[nodiscard]] std::string text() const;
  [[nodiscard]] double number(double low, double high) const;
  [[nodiscard]] int whole(int low, int high) const;

  template <typename Meaning>
  [[nodiscard]] Meaning one_of(Names<Meaning> names) const {
    const std::string found = text();
    std::string expected;
    for (const auto& [name, meaning] : names) {
      if (name == found) return meaning;
      expected += (expected.empty() ? "" : ", ") + std::string(name);
    }
    refuse("one of " + expected);
  }
  /// Names of which none stands twice.
  template <typename Meaning>
  [[nodiscard]] std::vector<Meaning> set_of(Names<Meaning> names) const {
    std::vector<Meaning> meanings;
    for (const StrictValue& value : elements(1, names.size())) {
      const Meaning meaning = value.one_of(names);
      for (const Meaning& known : meanings)
        if (known == meaning) value.refuse("a name once");
      meanings.push_back(meaning);
    }
    return meanings;
  }

 private:
  const nlohmann::json& value_;
  std::string path_;
};

}  // namespace stillmap::mapping
