#include "blobs/s3_xml.hpp"

#include <array>
#include <utility>

namespace stillmap::server {
namespace {

using Entity = std::pair<std::string_view, char>;
constexpr std::array<Entity, 5> kEntities = {
    {{"&lt;", '<'}, {"&gt;", '>'}, {"&quot;", '"'}, {"&apos;", '\''}, {"&amp;", '&'}}};

std::string xml_decoded(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    bool is_entity = false;
    for (const auto& [entity, character] : kEntities) {
      if (!text.starts_with(entity)) continue;
      result += character;
      text.remove_prefix(entity.size());
      is_entity = true;
      break;
    }
    if (is_entity) continue;
    result += text.front();
    text.remove_prefix(1);
  }
  return result;
}

}  // namespace

std::vector<std::string_view> xml_elements(std::string_view xml, std::string_view name) {
  const std::string opening = "<" + std::string(name) + ">";
  const std::string closing = "</" + std::string(name) + ">";
  std::vector<std::string_view> found;
  while (true) {
    const std::size_t begin = xml.find(opening);
    if (begin == xml.npos) return found;
    xml.remove_prefix(begin + opening.size());
    const std::size_t end = xml.find(closing);
    if (end == xml.npos) return found;
    found.push_back(xml.substr(0, end));
    xml.remove_prefix(end + closing.size());
  }
}

std::optional<std::string> xml_text(std::string_view xml, std::string_view name) {
  const auto found = xml_elements(xml, name);
  if (found.empty()) return std::nullopt;
  return xml_decoded(found.front());
}

std::string xml_escaped(std::string_view text) {
  std::string result;
  for (const char c : text) {
    std::string_view replaced(&c, 1);
    for (const auto& [entity, character] : kEntities)
      if (character == c) replaced = entity;
    result += replaced;
  }
  return result;
}

}  // namespace stillmap::server
