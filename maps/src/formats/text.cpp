#include <stillmap/maps/text.hpp>

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <numeric>
#include <system_error>

#include "formats/file_bytes.hpp"

namespace stillmap::maps {
namespace {

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

template <typename Number>
std::optional<Number> parse_whole(std::string_view text) {
  Number value{};
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || stop != end) return std::nullopt;
  return value;
}

/// Decimal digits without their point: value = digits * 10^exponent.
struct Decimal {
  bool negative = false;
  std::string digits;
  int exponent = 0;
};

std::optional<Decimal> parse_decimal(std::string_view text) {
  Decimal decimal;
  std::size_t i = 0;
  if (i < text.size() && (text[i] == '+' || text[i] == '-')) decimal.negative = text[i++] == '-';
  for (; i < text.size() && is_digit(text[i]); ++i) decimal.digits += text[i];
  if (i < text.size() && text[i] == '.') {
    for (++i; i < text.size() && is_digit(text[i]); ++i) {
      decimal.digits += text[i];
      --decimal.exponent;
    }
  }
  if (decimal.digits.empty()) return std::nullopt;
  if (i < text.size() && (text[i] == 'e' || text[i] == 'E')) {
    ++i;
    if (i < text.size() && text[i] == '+') ++i;
    const std::optional<int> exponent = parse_whole<int>(text.substr(i));
    if (!exponent || std::abs(*exponent) > 1000) return std::nullopt;
    decimal.exponent += *exponent;
    i = text.size();
  }
  if (i != text.size()) return std::nullopt;
  return decimal;
}

/// Single letters that are wrong, missing, too many, or swapped with the next
/// (Damerau-Levenshtein, each place edited once).
std::size_t edits_between(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1);
  std::vector<std::size_t> last(b.size() + 1);
  std::vector<std::size_t> now(b.size() + 1);
  std::iota(last.begin(), last.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    now[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t wrong = a[i - 1] == b[j - 1] ? 0 : 1;
      now[j] = std::min({last[j] + 1, now[j - 1] + 1, last[j - 1] + wrong});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        now[j] = std::min(now[j], before[j - 2] + 1);
    }
    std::swap(before, last);
    std::swap(last, now);
  }
  return last[b.size()];
}

}  // namespace

std::string read_text(const std::filesystem::path& file, std::uintmax_t most_bytes) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  if (!error && size > most_bytes)
    throw InputError(file.string(), std::to_string(size) + " bytes",
                     "at most " + std::to_string(most_bytes));
  const FileBytes bytes = read_bytes(file);
  std::string_view text(reinterpret_cast<const char*>(bytes.span().data()), bytes.span().size());
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  return std::string(text);
}

std::vector<std::string_view> split_fields(std::string_view line, std::size_t limit) {
  std::vector<std::string_view> fields;
  // Of a line of points; growing to it took longer than the rest.
  fields.reserve(std::min<std::size_t>(limit, 16));
  for (std::size_t i = 0; i < line.size() && fields.size() < limit;) {
    if (is_blank(line[i])) {
      ++i;
      continue;
    }
    const std::size_t begin = i;
    while (i < line.size() && !is_blank(line[i])) ++i;
    fields.push_back(line.substr(begin, i - begin));
  }
  return fields;
}

std::optional<std::string_view> take_line(std::string_view& rest) {
  if (rest.empty()) return std::nullopt;
  const std::size_t end = rest.find('\n');
  const std::string_view line = rest.substr(0, end);
  rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
  return line;
}

std::optional<double> parse_number(std::string_view text) {
  // from_chars knows no plus sign, but writers of exponents and of offsets do.
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  return parse_whole<double>(text);
}

std::optional<std::uint64_t> parse_count(std::string_view text) {
  return parse_whole<std::uint64_t>(text);
}

std::optional<std::int64_t> parse_stamp_ns(std::string_view text) {
  std::optional<Decimal> decimal = parse_decimal(text);
  if (!decimal) return std::nullopt;
  std::string& digits = decimal->digits;
  digits.erase(0, std::min(digits.find_first_not_of('0'), digits.size() - 1));
  const int shift = decimal->exponent + 9;  // zeros to append, or digits to cut
  bool round_up = false;
  if (shift < 0) {
    const auto cut = static_cast<std::size_t>(-shift);
    round_up = cut <= digits.size() && digits[digits.size() - cut] >= '5';
    digits.resize(cut >= digits.size() ? 0 : digits.size() - cut);
    if (digits.empty()) digits = "0";
  } else if (digits != "0") {
    if (shift > 19) return std::nullopt;
    digits.append(static_cast<std::size_t>(shift), '0');
  }
  const std::optional<std::int64_t> value = parse_whole<std::int64_t>(digits);
  if (!value || *value == std::numeric_limits<std::int64_t>::max()) return std::nullopt;
  const std::int64_t rounded = *value + (round_up ? 1 : 0);
  return decimal->negative ? -rounded : rounded;
}

std::vector<NumberLine> number_lines(std::string_view text) {
  std::vector<NumberLine> lines;
  std::size_t number = 0;
  while (const std::optional<std::string_view> line = take_line(text)) {
    ++number;
    std::vector<std::string_view> fields = split_fields(*line);
    if (fields.empty() || fields.front().front() == '#') continue;
    lines.push_back({number, std::move(fields)});
  }
  return lines;
}

std::string place(const std::filesystem::path& file, std::size_t line) {
  return file.string() + " line " + std::to_string(line);
}

void parse_finite(const std::filesystem::path& file, const NumberLine& line,
                  std::span<double> values) {
  if (line.fields.size() != values.size()) {
    throw InputError(place(file, line.line), std::to_string(line.fields.size()) + " fields",
                     std::to_string(values.size()) + " numbers");
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::optional<double> value = parse_number(line.fields[i]);
    if (!value || !std::isfinite(*value)) {
      throw InputError(place(file, line.line), quoted(line.fields[i]),
                       "a finite number: correct the line");
    }
    values[i] = *value;
  }
}

std::string one_line(std::string_view text, std::size_t most) {
  std::size_t end = std::min(text.size(), most);
  // A letter of several bytes is not cut in two.
  while (end > 0 && end < text.size() && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U)
    --end;
  std::string line(text.substr(0, end));
  for (char& letter : line) {
    const auto code = static_cast<unsigned char>(letter);
    if (code < 0x20 || code == 0x7f) letter = '?';
  }
  return end < text.size() ? line + "..." : line;
}

std::string quoted(std::string_view text) { return "'" + one_line(text) + "'"; }

std::optional<std::string> nearest_of(const std::string& word,
                                      const std::vector<std::string>& names) {
  constexpr std::size_t kPrefix = 3;    // fewer letters begin too many names
  constexpr std::size_t kLongest = 64;  // bounds the work for a text that is no name
  const std::size_t dashes = std::min(word.find_first_not_of('-'), word.size());
  std::optional<std::string> nearest;
  // One letter is near to any other.
  if (word.size() < dashes + 2 || word.size() > kLongest) return nearest;
  // A third of the letters may be wrong.
  std::size_t fewest = std::max<std::size_t>(1, (word.size() - dashes) / 3) + 1;
  for (const std::string& name : names) {
    const bool begins = word.size() >= kPrefix + dashes && name.starts_with(word);
    const std::size_t edits = begins ? 1 : edits_between(word, name);
    if (edits >= fewest) continue;
    fewest = edits;
    nearest = name;
  }
  return nearest;
}

}  // namespace stillmap::maps
