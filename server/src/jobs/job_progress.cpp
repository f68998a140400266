#include "jobs/job_progress.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace stillmap::server {
namespace {

using RequestJson = nlohmann::json;

constexpr std::size_t kLongestText = 200;

/// Cut and without what cannot be printed.
std::string text_in(const RequestJson& line, const char* key) {
  const auto found = line.find(key);
  if (found == line.end() || !found->is_string()) return {};
  std::string text = found->get<std::string>().substr(0, kLongestText);
  for (char& byte : text)
    if (static_cast<unsigned char>(byte) < 0x20) byte = ' ';
  return text;
}

/// Not negative; nothing for anything else.
std::optional<double> number_in(const RequestJson& line, const char* key) {
  const auto found = line.find(key);
  if (found == line.end() || !found->is_number()) return std::nullopt;
  const double value = found->get<double>();
  return std::isfinite(value) && value >= 0.0 ? std::optional<double>(value) : std::nullopt;
}

}  // namespace

bool ProgressReader::append(std::string_view bytes) {
  bool is_new = false;
  while (!bytes.empty()) {
    const std::size_t end = bytes.find('\n');
    const std::string_view part = bytes.substr(0, end);
    if (line_.size() + part.size() > kLongestLine) too_long_ = true;
    if (!too_long_) line_ += part;
    if (end == std::string_view::npos) break;
    if (too_long_) {
      ++unread_;
    } else if (!line_.empty()) {
      is_new = read_line(line_) || is_new;
    }
    line_.clear();
    too_long_ = false;
    bytes.remove_prefix(end + 1);
  }
  return is_new;
}

bool ProgressReader::read_line(std::string_view text) {
  const RequestJson line = RequestJson::parse(text, nullptr, false);
  const std::optional<double> fraction =
      line.is_object() ? number_in(line, "fraction") : std::nullopt;
  if (!fraction || *fraction > 1.0) {
    ++unread_;
    return false;
  }
  progress_.fraction = std::max(progress_.fraction, *fraction);
  progress_.stage = text_in(line, "stage");
  progress_.eta_s = number_in(line, "eta_s");
  if (text_in(line, "outcome") == "failed") failure_ = text_in(line, "message");
  return true;
}

}  // namespace stillmap::server
