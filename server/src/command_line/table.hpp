#pragma once

#include <string>
#include <utility>
#include <vector>

namespace stillmap::command_line {

/// A summary for people: names and values, in two columns.
class Table {
 public:
  void add(std::string name, std::string value) {
    rows_.emplace_back(std::move(name), std::move(value));
  }
  /// Writes to stdout.
  void print() const;

 private:
  std::vector<std::pair<std::string, std::string>> rows_;
};

/// The value, or a dash where it is not finite.
[[nodiscard]] std::string number_text(double value, int digits);
/// A share of 1 as "98.25 %", or a dash for NaN.
[[nodiscard]] std::string percent_text(double share, int digits);
/// 1234567 -> "1 234 567".
[[nodiscard]] std::string grouped(unsigned long long number);

}  // namespace stillmap::command_line
