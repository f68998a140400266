#include "option_table.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <type_traits>

namespace stillmap::server {
namespace {

std::string upper(char word_end, std::string_view key) {
  std::string result(key);
  for (char& c : result) {
    if (c == '.' || c == '_') {
      c = word_end;
    } else if (word_end == '_' && c >= 'a' && c <= 'z') {
      c = static_cast<char>(c - 'a' + 'A');
    }
  }
  return result;
}

bool is_plain(std::string_view text) {
  return text.size() <= kMostTextBytes && std::ranges::none_of(text, [](char c) {
           return static_cast<unsigned char>(c) < 0x20 || c == 0x7f;
         });
}

/// 1e9 and 5.0 are integers too, as in JSON Schema.
std::optional<std::int64_t> whole(const OptionValue& value) {
  if (const auto* integer = std::get_if<std::int64_t>(&value)) return *integer;
  const auto* real = std::get_if<double>(&value);
  constexpr double kExact = 9007199254740992.0;
  if (real == nullptr || !(std::abs(*real) <= kExact) || std::trunc(*real) != *real) return {};
  return static_cast<std::int64_t>(*real);
}

std::optional<double> number(const OptionValue& value) {
  if (const auto* real = std::get_if<double>(&value)) return *real;
  if (const auto* integer = std::get_if<std::int64_t>(&value)) return static_cast<double>(*integer);
  return {};
}

template <typename Value>
std::optional<Value> read_number(std::string_view text) {
  Value value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return {};
  return value;
}

struct Setter {
  const Option& option;
  const OptionValue& value;

  [[nodiscard]] bool within(double number) const {
    return number >= option.least && number <= option.most;
  }
  bool operator()(bool* field) const {
    const auto* flag = std::get_if<bool>(&value);
    if (flag != nullptr) *field = *flag;
    return flag != nullptr;
  }
  bool operator()(double* field) const {
    const std::optional<double> real = number(value);
    if (!real || !within(*real)) return false;
    *field = *real;
    return true;
  }
  bool operator()(std::string* field) const {
    const auto* text = std::get_if<std::string>(&value);
    if (text == nullptr || !is_plain(*text)) return false;
    if (!option.choices.empty() && std::ranges::find(option.choices, *text) == option.choices.end())
      return false;
    *field = *text;
    return true;
  }
  template <typename Integer>
  bool operator()(Integer* field) const {
    const std::optional<std::int64_t> integer = whole(value);
    // The table's bounds lie within the field's type, which a test holds.
    if (!integer || !within(static_cast<double>(*integer))) return false;
    *field = static_cast<Integer>(*integer);
    return true;
  }
};

}  // namespace

OptionKind Option::kind() const {
  ServerOptions any;
  const OptionField where = field(any);
  if (std::holds_alternative<bool*>(where)) return OptionKind::kFlag;
  if (std::holds_alternative<double*>(where)) return OptionKind::kReal;
  if (!std::holds_alternative<std::string*>(where)) return OptionKind::kInteger;
  return choices.empty() ? OptionKind::kText : OptionKind::kChoice;
}

std::string Option::flag() const { return "--" + upper('-', key); }

std::string Option::variable() const { return std::string(kVariablePrefix) + upper('_', key); }

std::string Option::expected() const {
  switch (kind()) {
    case OptionKind::kFlag:
      return "true or false";
    case OptionKind::kInteger:
      return fmt::format("an integer in [{:.0f}, {:.0f}]", least, most);
    case OptionKind::kReal:
      return fmt::format("a number in [{:.10g}, {:.10g}]", least, most);
    case OptionKind::kChoice:
      return fmt::format("one of {}", fmt::join(choices, ", "));
    case OptionKind::kText:
      break;
  }
  return fmt::format("text of at most {} bytes without control characters", kMostTextBytes);
}

OptionValue Option::get(const ServerOptions& options) const {
  ServerOptions copy = options;
  return std::visit(
      [](const auto* where) -> OptionValue {
        using Value = std::remove_cvref_t<decltype(*where)>;
        if constexpr (std::is_same_v<Value, int> || std::is_same_v<Value, std::size_t>) {
          return static_cast<std::int64_t>(*where);
        } else {
          return *where;
        }
      },
      field(copy));
}

bool Option::set(ServerOptions& options, const OptionValue& value) const {
  return std::visit(Setter{*this, value}, field(options));
}

std::optional<OptionValue> read_value(const Option& option, std::string_view text) {
  switch (option.kind()) {
    case OptionKind::kFlag:
      if (text == "true") return true;
      if (text == "false") return false;
      return {};
    case OptionKind::kInteger:
      if (const auto integer = read_number<std::int64_t>(text)) return *integer;
      [[fallthrough]];
    case OptionKind::kReal:
      if (const auto real = read_number<double>(text)) return *real;
      return {};
    case OptionKind::kText:
    case OptionKind::kChoice:
      break;
  }
  return std::string(text);
}

}  // namespace stillmap::server
