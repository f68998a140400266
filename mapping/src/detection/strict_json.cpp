#include "detection/strict_json.hpp"

#include <stillmap/maps/error.hpp>

#include <functional>
#include <set>
#include <vector>

namespace stillmap::mapping {
namespace {

constexpr int kMaxDepth = 8;
constexpr std::size_t kLongestText = 60;

std::string one_line(std::string_view text) {
  std::string line(text.substr(0, kLongestText));
  for (char& letter : line) {
    const auto code = static_cast<unsigned char>(letter);
    if (code < 0x20 || code >= 0x7f) letter = '?';
  }
  return text.size() > kLongestText ? line + "..." : line;
}

/// Refuses depth and doubled keys while the text is read, before anything is built of it.
class Guard {
 public:
  explicit Guard(const std::string& name) : name_(name) {}

  bool operator()(int depth, nlohmann::json::parse_event_t event, nlohmann::json& value) {
    using Event = nlohmann::json::parse_event_t;
    if (depth > kMaxDepth) {
      throw maps::InputError(name_, "JSON nested more than " + std::to_string(kMaxDepth) + " deep",
                             "at most that");
    }
    if (event == Event::object_start) {
      keys_.emplace_back();
    } else if (event == Event::object_end) {
      keys_.pop_back();
    } else if (event == Event::key && !keys_.back().insert(value.get<std::string>()).second) {
      throw maps::InputError(name_, "key " + in_quotes(value.get<std::string>()) + " twice",
                             "it once");
    }
    return true;
  }

 private:
  const std::string& name_;
  std::vector<std::set<std::string>> keys_;
};

}  // namespace

nlohmann::json parse_strict_json(std::string_view text, const std::string& name) {
  try {
    Guard guard(name);
    return nlohmann::json::parse(text, std::ref(guard));
  } catch (const nlohmann::json::exception& error) {
    throw maps::InputError(name, "no JSON (" + one_line(error.what()) + ")", "JSON");
  }
}

std::string in_quotes(std::string_view text) { return "\"" + one_line(text) + "\""; }

std::string described(const nlohmann::json& value) {
  if (value.is_array()) return "an array of " + std::to_string(value.size());
  if (value.is_object()) return "an object";
  if (value.is_string()) return in_quotes(value.get_ref<const std::string&>());
  return one_line(value.dump());
}

}  // namespace stillmap::mapping
