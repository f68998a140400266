#include "value_text.hpp"

#include <nlohmann/json.hpp>

namespace stillmap::server {
namespace {

std::string json_text(const nlohmann::json& value) {
  return value.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

}  // namespace

std::string value_text(const OptionValue& value) {
  return std::visit([](const auto& each) { return json_text(each); }, value);
}

std::string shown_text(std::string_view text) {
  constexpr std::size_t kMost = 80;
  if (text.size() <= kMost) return json_text(text);
  return json_text(std::string(text.substr(0, kMost))) + "...";
}

}  // namespace stillmap::server
