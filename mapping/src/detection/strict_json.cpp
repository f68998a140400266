#include "detection/strict_json.hpp"

#include <stillmap/maps/error.hpp>

#include <set>
#include <vector>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kMaxDepth = 8;
constexpr std::size_t kLongestText = 60;

std::string one_line(std::string_view text) {
  std::string line(text.substr(0, kLongestText));
  for (char& letter : line) {
    const auto code = static_cast<unsigned char>(letter);
    if (code < 0x20 || code >= 0x7f) letter = '?';
  }
  return text.size() > kLongestText ? line + "..." : line;
}

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
    throw maps::InputError(name_, "key " + in_quotes(key) + " twice", "it once");
  }

  bool parse_error(std::size_t /*at*/, const std::string& /*token*/,
                   const nlohmann::json::exception& error) override {
    throw maps::InputError(name_, "no JSON (" + one_line(error.what()) + ")", "JSON");
  }

 private:
  bool open() {
    if (keys_.size() == kMaxDepth)
      throw maps::InputError(name_, "JSON nested more than " + std::to_string(kMaxDepth) + " deep",
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

nlohmann::json parse_strict_json(std::string_view text, const std::string& name) {
  Guard guard(name);
  nlohmann::json::sax_parse(text, &guard);
  return nlohmann::json::parse(text);
}

std::string in_quotes(std::string_view text) { return "\"" + one_line(text) + "\""; }

std::string described(const nlohmann::json& value) {
  if (value.is_array()) return "an array of " + std::to_string(value.size());
  if (value.is_object()) return "an object";
  if (value.is_string()) return in_quotes(value.get_ref<const std::string&>());
  return one_line(value.dump());
}

}  // namespace stillmap::mapping
