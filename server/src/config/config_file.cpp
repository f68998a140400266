#include "config_file.hpp"

#include "value_text.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <fstream>
#include <limits>
#include <set>

namespace stillmap::server {
namespace {

using ConfigJson = nlohmann::json;

/// A file with more mistakes than this is another kind of file, and naming each costs time.
constexpr std::size_t kMostProblems = 50;

bool is_group(const std::string& path) {
  return std::ranges::any_of(all_options(), [prefix = path + "."](const Option& option) {
    return option.key.starts_with(prefix);
  });
}

/// Takes the parser's events, so that doubled keys are seen and nothing is built from a hostile
/// file. The parser keeps no stack of its own calls: depth costs a bit a level.
/// Not maps::JsonField: an operator is told all faults at once, each with its line.
class ConfigReader final : public ConfigJson::json_sax_t {
 public:
  ConfigReader(std::string name, ConfigText& result) : name_(std::move(name)), result_(result) {}

  bool null() override { return refuse("null"); }
  bool boolean(bool value) override { return take(value); }
  bool number_integer(number_integer_t value) override { return take(std::int64_t{value}); }
  bool number_unsigned(number_unsigned_t value) override {
    constexpr auto kMost = static_cast<number_unsigned_t>(std::numeric_limits<std::int64_t>::max());
    return value <= kMost ? take(static_cast<std::int64_t>(value))
                          : take(static_cast<double>(value));
  }
  bool number_float(number_float_t value, const string_t&) override { return take(value); }
  bool string(string_t& value) override { return take(std::move(value)); }
  bool binary(binary_t&) override { return refuse("bytes"); }

  bool start_object(std::size_t) override {
    if (skipped_ > 0 || (depth_ > 0 && !in_group())) return skip("an object");
    ++depth_;
    return true;
  }
  bool end_object() override { return leave(); }
  bool start_array(std::size_t) override { return skip("an array"); }
  bool end_array() override { return leave(); }

  bool key(string_t& value) override {
    if (skipped_ > 0) return true;
    dotted_ = value.find('.') != std::string::npos;
    path_ = depth_ == 2 ? group_ + "." + value : value;
    if (depth_ == 1) group_ = value;
    if (seen_.insert(path_).second) return true;
    return add(path_, "it twice", "it once");
  }

  bool parse_error(std::size_t, const std::string&, const ConfigJson::exception& error) override {
    // "[json.exception.parse_error.101] parse error at line 1, column 2: syntax error while ..."
    const std::string_view text = error.what();
    const std::size_t start = text.find("] ");
    add("", std::string(start == std::string_view::npos ? text : text.substr(start + 2)),
        "JSON, comments allowed");
    return false;
  }

 private:
  bool add(const std::string& path, std::string found, std::string expected) {
    const std::string shown = path.empty() ? path : display(path);
    result_.problems.push_back({name_, shown, std::move(found), std::move(expected)});
    if (result_.problems.size() < kMostProblems) return true;
    result_.problems.push_back({name_, "", "more that is wrong", "what is named above"});
    return false;
  }

  /// Known keys are plain; what a stranger wrote may be anything.
  static std::string display(const std::string& path) {
    return find_option(path) != nullptr || is_group(path) ? path : shown_text(path);
  }

  [[nodiscard]] const Option* option() const { return dotted_ ? nullptr : find_option(path_); }
  [[nodiscard]] bool in_group() const { return !dotted_ && depth_ == 1 && is_group(path_); }

  bool refuse(const std::string& found) {
    if (skipped_ > 0) return true;
    if (depth_ == 0) return add("", found, "an object of options");
    if (const Option* known = option()) return add(path_, found, known->expected());
    if (dotted_) return add(path_, found, "an object for each group instead of a dotted key");
    if (in_group()) return add(path_, found, "an object of options");
    const std::string_view nearest = nearest_key(path_);
    return add(
        path_, found,
        nearest.empty() ? "a known key" : fmt::format("a known key, the nearest is {}", nearest));
  }

  bool take(OptionValue value) {
    if (skipped_ > 0) return true;
    const Option* known = depth_ > 0 ? option() : nullptr;
    ServerOptions scratch;
    if (known == nullptr || !known->set(scratch, value)) return refuse(found_text(value));
    result_.values.emplace_back(known, std::move(value));
    return true;
  }

  static std::string found_text(const OptionValue& value) {
    const auto* text = std::get_if<std::string>(&value);
    return text != nullptr ? shown_text(*text) : value_text(value);
  }

  /// Says what is wrong at its top, and leaves out what is in it.
  bool skip(const std::string& found) {
    const bool go_on = refuse(found);
    ++skipped_;
    return go_on;
  }

  bool leave() {
    if (skipped_ > 0) {
      --skipped_;
    } else {
      --depth_;
    }
    return true;
  }

  std::string name_;
  ConfigText& result_;
  std::string group_;
  std::string path_;
  /// Whether the last key itself has a dot, which none of ours has.
  bool dotted_ = false;
  std::set<std::string> seen_;
  /// Objects entered, at most 2: the options, and a group of them.
  int depth_ = 0;
  /// Objects and arrays entered below something that was refused.
  std::size_t skipped_ = 0;
};

}  // namespace

std::string_view nearest_key(std::string_view key) {
  std::vector<std::string> keys;
  for (const Option& option : all_options()) keys.emplace_back(option.key);
  const auto nearest = maps::nearest_of(std::string(key), keys);
  return nearest ? find_option(*nearest)->key : std::string_view();
}

ConfigText parse_config(std::string_view text, const std::string& name) {
  ConfigText result;
  if (text.size() > kMostConfigBytes) {
    result.problems.push_back(
        {name, "", "a larger file", fmt::format("at most {} bytes", kMostConfigBytes)});
    return result;
  }
  ConfigReader reader(name, result);
  constexpr bool kWhole = true;
  constexpr bool kComments = true;
  ConfigJson::sax_parse(text.begin(), text.end(), &reader, ConfigJson::input_format_t::json, kWhole,
                        kComments);
  return result;
}

ConfigText read_config(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::string text(kMostConfigBytes + 1, '\0');
  std::error_code error;
  const bool folder = std::filesystem::is_directory(file, error);
  if (stream) stream.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (folder || stream.bad() || !(stream || stream.eof())) {
    ConfigText result;
    result.problems.push_back(
        {file.string(), "", folder ? "a folder" : "nothing to read", "a file"});
    return result;
  }
  text.resize(static_cast<std::size_t>(stream.gcount()));
  return parse_config(text, file.string());
}

}  // namespace stillmap::server
