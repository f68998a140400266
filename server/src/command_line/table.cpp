#include "table.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

namespace stillmap::command_line {

void Table::print() const {
  std::size_t width = 0;
  for (const auto& [name, value] : rows_) width = std::max(width, name.size());
  for (const auto& [name, value] : rows_) fmt::print("{:<{}}  {}\n", name, width, value);
}

std::string number_text(double value, int digits) {
  return std::isfinite(value) ? fmt::format("{:.{}f}", value, digits) : "-";
}

std::string percent_text(double share, int digits) {
  return std::isnan(share) ? "-" : fmt::format("{:.{}f} %", 100.0 * share, digits);
}

std::string grouped(unsigned long long number) {
  std::string text = std::to_string(number);
  for (std::size_t at = text.size(); at > 3;) {
    at -= 3;
    text.insert(at, 1, ' ');
  }
  return text;
}

}  // namespace stillmap::command_line
