#include "signing/map_signature.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// What is signed. The first line says what it is, so that it is no signature of anything else.
std::string text_of(std::string_view map, std::string_view digest) {
  return fmt::format("stillmap map version\n{}\n{}\n", map, digest);
}

std::string text_in(const nlohmann::json& object, const char* name, std::size_t digits) {
  const auto found = object.is_object() ? object.find(name) : object.end();
  if (!object.is_object() || found == object.end() || !found->is_string()) return {};
  std::string text = found->get<std::string>();
  const bool is_hex = text.find_first_not_of("0123456789abcdef") == std::string::npos;
  return is_hex && text.size() == digits ? text : std::string();
}

}  // namespace

MapSignature sign_map(const SigningKey& key, std::string_view map, std::string_view digest) {
  return {key.public_key(), key.sign(text_of(map, digest))};
}

bool is_signature_of(const MapSignature& signature, std::string_view map, std::string_view digest) {
  return is_signature(signature.signature, text_of(map, digest), signature.key);
}

bool is_signed_by(const PublicKeys& keys, const std::vector<MapSignature>& signatures,
                  std::string_view map, std::string_view digest) {
  return std::ranges::any_of(signatures, [&](const MapSignature& each) {
    return keys.contains(each.key) && is_signature_of(each, map, digest);
  });
}

std::string signatures_text(const std::vector<MapSignature>& signatures) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const MapSignature& each : signatures)
    list.push_back({{"key", each.key}, {"signature", each.signature}});
  return nlohmann::ordered_json{{"signatures", std::move(list)}}.dump(2) + "\n";
}

std::vector<MapSignature> parse_signatures(std::string_view text, const std::string& name) {
  constexpr std::size_t kKeyDigits = 64, kSignatureDigits = 128;
  const auto refuse = [&](const std::string& found) {
    throw maps::InputError(name, found,
                           "{\"signatures\": [{\"key\": 64 digits of 0-9 and a-f, \"signature\": "
                           "128}]}, as `stillmap keys sign` writes it: sign again");
  };
  if (text.size() > kMostSignaturesBytes) refuse(fmt::format("{} bytes", text.size()));
  const auto json = nlohmann::json::parse(text, nullptr, false);
  const auto list = json.is_object() ? json.find("signatures") : json.end();
  if (!json.is_object() || list == json.end() || !list->is_array()) refuse("no signatures");
  if (list->size() > kMostSignatures) refuse(fmt::format("{} signatures", list->size()));
  std::vector<MapSignature> signatures;
  for (const auto& each : *list) {
    signatures.push_back(
        {text_in(each, "key", kKeyDigits), text_in(each, "signature", kSignatureDigits)});
    if (signatures.back().key.empty() || signatures.back().signature.empty())
      refuse(fmt::format("no signature at number {}", signatures.size() - 1));
  }
  return signatures;
}

std::vector<MapSignature> signatures_beside(const fs::path& package) {
  const fs::path file = package / kSignaturesName;
  std::error_code error;
  if (!fs::exists(file, error)) return {};
  if (fs::file_size(file, error) > kMostSignaturesBytes)
    throw maps::InputError(file.string(), "a large file", "signatures: remove it and sign again");
  return parse_signatures(maps::read_text(file), file.string());
}

void add_signature_beside(const fs::path& package, const MapSignature& signature) {
  std::vector<MapSignature> signatures = signatures_beside(package);
  std::erase_if(signatures, [&](const MapSignature& each) { return each.key == signature.key; });
  if (signatures.size() >= kMostSignatures)
    throw maps::InputError((package / kSignaturesName).string(),
                           fmt::format("{} signatures", signatures.size()),
                           "fewer: remove those of old keys");
  signatures.push_back(signature);
  const fs::path file = package / kSignaturesName;
  const fs::path part = file.string() + ".part";
  std::ofstream(part) << signatures_text(signatures) << std::flush;
  std::error_code error;
  fs::rename(part, file, error);
  if (error || signatures_beside(package) != signatures)
    throw maps::StorageError(file.string(), "cannot be written: look at the disk's room");
}

}  // namespace stillmap::server
